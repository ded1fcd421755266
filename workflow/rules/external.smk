rule contact_overlay:
    """Contacts found beside those known from elsewhere: events, foot switches, forces."""
    input:
        recordings=expand(f"{RESULTS}/level/{{recording}}.h5", recording=list(EXTERNAL)),
        touchdowns=rules.pairs.output.touchdowns,
        external=[
            block["file"]
            for blocks in EXTERNAL.values()
            for block in blocks.values()
            if block["file"]
        ],
    output:
        contacts=f"{RESULTS}/tables/contact_overlay.csv",
        summary=f"{RESULTS}/tables/contact_overlay_summary.csv",
        thresholds=f"{RESULTS}/tables/contact_overlay_thresholds.csv",
        example=f"{RESULTS}/tables/contact_overlay_example.csv",
    log:
        f"{RESULTS}/logs/contact_overlay.log",
    benchmark:
        f"{RESULTS}/benchmarks/contact_overlay.tsv"
    params:
        configured=EXTERNAL,
        external=STUDY["external"],
        rate_hz=STUDY["input"]["rate_hz"],
        code=code("contact_overlay"),
    script:
        "../scripts/contact_overlay.py"


rule figure_contact_overlay:
    """Error of each contact against what is known from elsewhere, and one landing with both."""
    input:
        contacts=rules.contact_overlay.output.contacts,
        summary=rules.contact_overlay.output.summary,
        example=rules.contact_overlay.output.example,
    output:
        figure("contact_overlay"),
    log:
        f"{RESULTS}/logs/figure_contact_overlay.log",
    benchmark:
        f"{RESULTS}/benchmarks/figure_contact_overlay.tsv"
    params:
        options=STUDY["figures"],
        code=code("figure_contact_overlay"),
    script:
        "../scripts/figure_contact_overlay.py"
