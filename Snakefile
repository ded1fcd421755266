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
# It is that of the Dockerfile, 3.13.15-slim-trixie; a tag beside the digest is refused here.
container: "docker://python@sha256:7c61056e61ac89e852de05f3dc6fa51a6dd2181797bceed46aa725dd7cb2cd3b"


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
