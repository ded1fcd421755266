"""hopdata: from motion-capture recordings to the figures, stage by stage.

snakemake --cores 2                                   the bundled sample
snakemake --cores 2 --configfile config/runner.yaml   another study
"""

from snakemake.utils import min_version

from hopdata import products

min_version("9.14")

# A config file given on the command line replaces the default one; it does not extend it.
if not workflow.overwrite_configfiles:

    configfile: "config/config.yaml"


# Base image for `--software-deployment-method apptainer`; hopdata must be installed in it by the
# three steps of the Makefile. Without that option (the default), this line does nothing and the
# active environment is used.
container: "docker://python:3.13-slim"


include: "workflow/rules/folder.smk"
include: "workflow/rules/common.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/line.smk"
include: "workflow/rules/truth.smk"
include: "workflow/rules/external.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/benchmarks.smk"
include: "workflow/rules/comparison.smk"


# Products beside the study, such as steering, bring rules of their own.
for product in products.installed():
    if product.rules.is_file():

        include: product.rules


rule all:
    default_target: True
    input:
        rules.report.output,
        FIGURES,
        f"{RESULTS}/verdict.json",
        f"{RESULTS}/quality.json",
        f"{RESULTS}/truth.json" if TRUTH_KNOWN else [],
