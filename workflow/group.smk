"""A group: one job runs the study of each subject, then one page shows them all.

snakemake --cores 2 --snakefile workflow/group.smk --workflow-profile profiles/default --configfile config/group.yaml
"""

import os
import sys
from functools import cache
from pathlib import Path

from hopdata.config.consistency import files_of
from hopdata.errors import HopdataError
from hopdata.provenance import code_digest
from hopdata.samples import read_group

try:
    GROUP = read_group(*workflow.overwrite_configfiles)
except HopdataError as error:
    sys.exit(f"hopdata: error: {error}")

RESULTS = f"results/{GROUP['study']}"
MEMBERS = GROUP["members"]
HERE = Path(os.path.relpath(workflow.current_basedir.get_path_or_uri(secret_free=True)))


def files(member):
    """Return the existing files of a member; its study reports missing ones."""
    recordings = MEMBERS[member]["config"]["recordings"]
    return [file for one in recordings for file in files_of(one) if os.path.exists(file)]


def size_mb(member):
    return sum(map(os.path.getsize, files(member))) / 1e6


def memory(wildcards, attempt):
    return (1000 + int(60 * size_mb(wildcards.member))) * 2 ** (attempt - 1)


def minutes(wildcards, attempt):
    """Ask for many times what a study takes: 1,000 hops 10 s, a million frames (60 MB) 1 min."""
    return (4 + int(size_mb(wildcards.member) / 4)) * 2 ** (attempt - 1)


@cache
def code(script):
    """Digest a script and all code that it uses, once for all members."""
    return code_digest(HERE / "scripts" / f"{script}.py")


include: "rules/folder.smk"


begin(GROUP["study"], (file for member in MEMBERS for file in files(member)), RESULTS)


wildcard_constraints:
    member="|".join(MEMBERS),


rule group:
    """Show all members on one page."""
    default_target: True
    input:
        members=expand(f"{RESULTS}/members/{{member}}/member.json", member=MEMBERS),
        captions=HERE / "captions" / "group.md",
    output:
        page=f"{RESULTS}/group.html",
        answer=f"{RESULTS}/group.json",
        table=f"{RESULTS}/tables/group.csv",
        figure=f"{RESULTS}/figures/group.svg",
    log:
        f"{RESULTS}/logs/group.log",
    params:
        group={key: value for key, value in GROUP.items() if key != "members"},
        code=lambda wildcards: code("group"),
    script:
        "scripts/group.py"


rule member:
    """Run the study of one subject in one condition, from its files to its page."""
    input:
        files=lambda wildcards: files(wildcards.member),
        captions=HERE / "captions",
    output:
        row=f"{RESULTS}/members/{{member}}/member.json",
        page=f"{RESULTS}/members/{{member}}/report.html",
    log:
        f"{RESULTS}/logs/{{member}}.log",
    resources:
        mem_mb=memory,
        runtime=minutes,
    params:
        member=lambda wildcards: MEMBERS[wildcards.member],
        stamps=lambda wildcards: stamps(files(wildcards.member)),
        code=lambda wildcards: code("member"),
    script:
        "scripts/member.py"
