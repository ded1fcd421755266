# One rule for each kind of figure in this study; `hopdata.figures.catalogue` lists the figures.
KINDS = ["landings", "maps"]
KINDS += ["truth"] if SIMULATED else []
KINDS += ["overlay"] if EXTERNAL else []


def asked(kind):
    """Return the figures of one kind that the study asks for."""
    left_out = [] if DISTANCES else [OF_DISTANCES]
    return [name for name in CATALOGUE[kind] if name not in left_out]


# The page shows the answer first, then the dissertation's figures.
FIGURE_NAMES = sorted(
    (name for kind in KINDS for name in asked(kind)),
    key=lambda name: (name != "verdict", not name.startswith("fig")),
)
FIGURES = expand(f"{RESULTS}/figures/{{name}}.{{format}}", name=FIGURE_NAMES, format=FORMATS)


def drawn(kind, folder, *, to):
    """Return input, output and parameters of a job that draws one kind of figure."""
    names = asked(kind)
    sources = sorted({source_of(name) for name in names})
    return {
        "input": {
            name: [f"{folder}/{file}" for file in tables_of(name, simulated=SIMULATED)]
            for name in names
        },
        "output": expand(f"{to}/{{name}}.{{format}}", name=names, format=FORMATS),
        "params": {
            "names": names,
            "options": STUDY["figures"],
            "code": code("figures", *sources),
        },
    }


for kind in KINDS:
    job = drawn(kind, RESULTS, to=f"{RESULTS}/figures")

    rule:
        name:
            f"figures_{kind}"
        input:
            **job["input"],
        output:
            job["output"],
        log:
            f"{RESULTS}/logs/figures_{kind}.log",
        benchmark:
            f"{RESULTS}/benchmarks/figures_{kind}.tsv"
        priority: 1  # longer than the other stages that only the page waits for
        resources:
            **needs(mb_a_mb=20, minutes=10),
        params:
            **job["params"],
        script:
            "../scripts/figures.py"
