# The page on the dissertation: `snakemake --cores 2 dissertation`. Each part is a job of its own; one
# that fails leaves a record that says why, and the others go on.
include: "common.smk"


for part_name, part_file in DISSERTATION_CODE.items():

    rule:
        name:
            f"dissertation_{part_name}"
        output:
            record=f"{DISSERTATION_PARTS}/{part_name}/rows.json",
            tables=directory(f"{DISSERTATION_PARTS}/{part_name}/tables"),
            figures=directory(f"{DISSERTATION_PARTS}/{part_name}/figures"),
        log:
            f"{DISSERTATION}/logs/{part_name}.log",
        benchmark:
            f"{DISSERTATION}/benchmarks/{part_name}.tsv"
        # The longest first, so that no core waits for the last one.
        priority: seconds_of(part_name)
        resources:
            **needs(minutes=20),
        params:
            part=part_name,
            repetitions=STUDY["dissertation"]["seeds"],
            seed=STUDY["seed"],
            figures=STUDY["figures"],
            code=dissertation_code("dissertation_part", part_file),
        script:
            "scripts/dissertation_part.py"


rule dissertation_page:
    """Set what all parts found in the order of the text, as a page, a document and a table."""
    input:
        records=expand(f"{DISSERTATION_PARTS}/{{part}}/rows.json", part=DISSERTATION_CODE),
        figures=expand(f"{DISSERTATION_PARTS}/{{part}}/figures", part=DISSERTATION_CODE),
    output:
        page=f"{DISSERTATION}/index.html",
        document=f"{DISSERTATION}/dissertation.md",
        found=f"{DISSERTATION}/found.json",
    log:
        f"{DISSERTATION}/logs/page.log",
    resources:
        **needs(minutes=10),
    params:
        code=dissertation_code("dissertation_page"),
    script:
        "scripts/dissertation_page.py"


rule dissertation:
    """Make the page on the dissertation: `snakemake --cores 2 dissertation`."""
    input:
        page=rules.dissertation_page.output.page,
        found=rules.dissertation_page.output.found,
        # What is missing here was not made by the last run, and is made now.
        records=rules.dissertation_page.input.records,
    log:
        f"{DISSERTATION}/logs/dissertation.log",
    localrule: True
    script:
        "scripts/dissertation.py"
