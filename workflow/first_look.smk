"""Both bundled studies and the page that compares them, in one run: no core waits for the other study.

snakemake --cores 2 --snakefile workflow/first_look.smk --workflow-profile profiles/default
"""

from snakemake_logger_plugin_hopdata import is_telling

from hopdata.causes import oom_kills
from hopdata.commands import deaths, owner
from hopdata.config.loading import read_yaml


module sample:
    snakefile:
        "../Snakefile"
    config:
        read_yaml("config/config.yaml")


use rule * from sample as sample_*


# The page is a rule of either study; here it is the sample's.
module control:
    snakefile:
        "../Snakefile"
    config:
        read_yaml("config/sample_control.yaml")


use rule * from control exclude first_look, verdicts as control_*


rule both:
    default_target: True
    input:
        rules.sample_all.input,
        rules.control_all.input,
        rules.sample_first_look.output,


OOM_BEFORE = oom_kills()


# Snakemake leaves out what the Snakefile of a module does here.
onstart:
    owner.begun()


onerror:
    if not is_telling():
        deaths.tell(log, oom_before=OOM_BEFORE)
