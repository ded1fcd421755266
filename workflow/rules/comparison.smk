# Two studies that are finished, one C1 and one not; `make both-sides` runs them first.
SIDES = {"thesis": "C1 hopper", "control": "control, not C1"}


rule both_sides:
    """Fig. 2.5 for both sides, with their verdicts."""
    input:
        distances=expand("results/{study}/tables/distances.csv", study=SIDES),
        summaries=expand("results/{study}/tables/distance_summary.csv", study=SIDES),
        verdicts=expand("results/{study}/verdict.json", study=SIDES),
    output:
        expand("results/both_sides/fig2_5_both_sides.{format}", format=FORMATS),
    log:
        "results/both_sides/both_sides.log",
    params:
        names=list(SIDES.values()),
        options=STUDY["figures"],
        code=code("both_sides"),
    script:
        "../scripts/both_sides.py"
