rule contact_overlay:
    """Compare the contacts found with events, foot switches or forces from other sources.

    These are files of the configuration, and force plates and events in a recording's own file.
    """
    input:
        recordings=expand(f"{RESULTS}/level/{{recording}}.h5", recording=list(EXTERNAL)),
        touchdowns=f"{RESULTS}/tables/touchdowns.csv",
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
        notes=f"{RESULTS}/tables/contact_overlay_notes.csv",
    log:
        f"{RESULTS}/logs/contact_overlay.log",
    benchmark:
        f"{RESULTS}/benchmarks/contact_overlay.tsv"
    resources:
        **needs(mb_a_mb=40, minutes=10),
    params:
        configured=EXTERNAL,
        external=STUDY["external"],
        rate_hz=STUDY["input"]["rate_hz"],
        unit=STUDY["input"]["unit"],
        stamps=stamps(
            block["file"]
            for blocks in EXTERNAL.values()
            for block in blocks.values()
            if block["file"]
        ),
        code=code("contact_overlay"),
    script:
        "../scripts/contact_overlay.py"
