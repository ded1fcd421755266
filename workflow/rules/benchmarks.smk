BENCHMARKS = ["integrator", "labelling", "density", "maps", "gait", "first_solve"]


rule benchmark:
    """Error and run time of one part of the library beside its peers, on one thread."""
    input:
        program="benchmarks/{name}.py",
    output:
        table="results/benchmarks/{name}.csv",
    log:
        "results/benchmarks/{name}.log",
    wildcard_constraints:
        name="|".join(BENCHMARKS),
    # Timings want the machine to themselves: one at a time, whatever --cores says.
    threads: workflow.cores
    params:
        python=sys.executable,
        code=lambda wildcards: code_digest(f"benchmarks/{wildcards.name}.py"),
    shell:
        "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 "
        "{params.python} {input.program} --out {output.table} > {log} 2>&1"


rule benchmarks:
    """All benchmark tables: `snakemake --cores 2 benchmarks`."""
    input:
        expand(rules.benchmark.output.table, name=BENCHMARKS),
