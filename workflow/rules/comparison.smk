# Compare finished studies, which `make both-sides` runs first: one that is C1, one that is not, and
# the first again with half the contact spread.
SIDES = drawn("sides", "results", to="results/both_sides")
COMPARED = ["thesis", "control", "half_spread"]


rule both_sides:
    """Draw Fig. 2.5 for both sides, with their verdicts."""
    input:
        **SIDES["input"],
    output:
        SIDES["output"],
    log:
        "results/both_sides/both_sides.log",
    resources:
        **needs(minutes=10),
    params:
        **SIDES["params"],
    script:
        "../scripts/figures.py"


rule prediction_ratios:
    """Summarise Fig. 2.4 of several studies in a few numbers."""
    input:
        summaries=expand("results/{study}/tables/prediction_summary.csv", study=COMPARED),
        touchdowns=expand("results/{study}/tables/touchdowns.csv", study=COMPARED),
    output:
        "results/both_sides/prediction_ratios.csv",
    log:
        "results/both_sides/prediction_ratios.log",
    resources:
        **needs(minutes=10),
    params:
        names=COMPARED,
        code=code("prediction_ratios"),
    script:
        "../scripts/prediction_ratios.py"


# The last step of `make figures` compares the bundled sample with its control.
PAIR = drawn("pair", "results", to="results/both_sides")
PAIRED = ["sample", "sample_control"]


rule verdicts:
    """Draw the verdicts on the sample and on its control, one below the other."""
    input:
        **PAIR["input"],
    output:
        PAIR["output"],
    log:
        "results/both_sides/verdicts_figure.log",
    resources:
        **needs(minutes=10),
    params:
        **PAIR["params"],
    script:
        "../scripts/figures.py"


rule first_look:
    """Show both verdicts on a page, with the numbers that do not distinguish the two."""
    input:
        figures=rules.verdicts.output,
        captions=f"{CAPTIONS}/verdicts.md",
        summaries=expand("results/{study}/tables/prediction_summary.csv", study=PAIRED),
        distances=expand("results/{study}/tables/distance_summary.csv", study=PAIRED),
        touchdowns=expand("results/{study}/tables/touchdowns.csv", study=PAIRED),
        recordings=["data/sample/hopper.h5", "data/sample/control.h5"],
    output:
        "results/both_sides/first_look.html",
    log:
        "results/both_sides/first_look.log",
    resources:
        **needs(minutes=10),
    params:
        names=["c1", "control"],
        code=code("first_look"),
    script:
        "../scripts/first_look.py"


rule bundled:
    """Write a simulated recording whose truth states how far apart its exact maps are."""
    input:
        recording=f"{RESULTS}/simulated/{{recording}}.h5",
        maps=f"{RESULTS}/maps/exact_maps.json",
        pairs=f"{RESULTS}/true_pairs.h5",
    output:
        f"{RESULTS}/bundled/{{recording}}.h5",
    log:
        f"{RESULTS}/logs/bundled_{{recording}}.log",
    resources:
        **needs(mb_a_mb=10, minutes=10),
    params:
        code=code("bundled"),
    script:
        "../scripts/bundled.py"
