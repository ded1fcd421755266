# Studies that are finished; `make both-sides` runs them first. Two sides, one C1 and one not, and the
# first with half of the contact spread.
SIDES = {"thesis": "C1 hopper", "control": "control, not C1"}
COMPARED = [*SIDES, "half_spread"]


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


rule prediction_ratios:
    """Fig. 2.4 of several studies in a few numbers."""
    input:
        summaries=expand("results/{study}/tables/prediction_summary.csv", study=COMPARED),
        touchdowns=expand("results/{study}/tables/touchdowns.csv", study=COMPARED),
    output:
        "results/both_sides/prediction_ratios.csv",
    log:
        "results/both_sides/prediction_ratios.log",
    params:
        names=COMPARED,
        code=code("prediction_ratios"),
    script:
        "../scripts/prediction_ratios.py"
