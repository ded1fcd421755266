#!/usr/bin/env bash
# Run the sample, then a group of four subjects, on a one-node SLURM on this machine, with profiles/slurm.
# One job is killed by kill -9 and a group job is cancelled; the results must equal those of a local run byte for
# byte. Run as root on a machine without SLURM: the script writes /etc/slurm/slurm.conf and removes it afterwards.
#
#   tests/cluster.sh [sample] [group]
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$(realpath "${VENV:-.venv}")/bin conf=/etc/slurm/slurm.conf
say() { echo "test-cluster: $*" >&2; }
stop() { say "$@"; exit 1; }
type slurmctld slurmd munged sbatch >/dev/null || stop "install slurm-wlm and munge"
"$bin/python" -c "import snakemake_executor_plugin_slurm" || stop "install it from PyPI"
[ "$(id -u)" = 0 ] || stop "only root can start SLURM"
[ ! -e $conf ] || stop "$conf: this machine has a SLURM already"
work=$(mktemp -d) started=()
trap 'scancel --me || true; pkill -KILL -f "$work/" || true; kill "${started[@]}" || true; rm -f $conf' EXIT
mkdir -p /etc/slurm "$work"/{state,spool,profile} && install -d -o munge /run/munge
cat >$conf <<END
ClusterName=test
SlurmctldHost=$(hostname -s)
SlurmUser=root
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
ProctrackType=proctrack/linuxproc
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=2
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
NodeName=$(hostname -s) CPUs=4 RealMemory=16000
PartitionName=short Nodes=ALL
END
runuser -u munge -- munged --foreground >"$work/munged.log" 2>&1 & started+=($!)
slurmctld -D >"$work/slurmctld.log" 2>&1 & started+=($!)
slurmd -D >"$work/slurmd.log" 2>&1 & started+=($!)
until [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; do sleep 1; done
# Fill in the two values, and enable the status command for a SLURM without accounting.
sed 's/PARTITION/short/; s/ACCOUNT/lab/; s/^# slurm-status/slurm-status/' profiles/slurm/config.yaml \
  >"$work/profile/config.yaml"
run() { # folder, options
  mkdir "$work/$1" && ln -s "$PWD/data" "$work/$1/data" && cp -r config "$work/$1/config"
  sed -i '6,$d' "$work/$1/config/group.tsv" && sed -i 's/hops: .*/hops: 150/' "$work/$1/config/group.yaml"
  (cd "$work/$1" && "$bin/snakemake" "${what[@]}" "${@:2}") >"$work/$1.log" 2>&1 ||
    stop "$work/$1.log: expected a study that ends, found: $(tail -n 3 "$work/$1.log")"
}
at_work() { # job: the processes that hold its log open
  until find /proc/[0-9]*/fd -lname "$work/cluster/results/*/logs/$1.log" 2>/dev/null | cut -d/ -f3 | grep .; do
    kill -0 $study || exit 1
    sleep 0.2
  done
}
both() { # retries, function that kills jobs
  run local --cores 2
  run cluster --profile "$work/profile" --slurm-init-seconds-before-status-checks 3 & study=$!
  "$2"
  wait $study
  [ "$(grep -c "Trying to restart" "$work/cluster.log")" = "$1" ] || stop "$work/cluster.log: expected $1 retries"
  # Compare everything but times and the record of the machine.
  diff -rq -x logs -x benchmarks -x report.html -x provenance.json "$work"/{local,cluster}/results
  rm -r "$work"/{local,cluster}
  say "$(grep -c "submitted with SLURM" "$work/cluster.log") submissions, the bytes of a local run"
}
sample() {
  kill -9 $(at_work verdict) && say "killed the verdict"
  at_work quality >/dev/null
  scancel "$(squeue -h -o "%i %k" | sed -n 's/ rule_page.*//p')" && say "cancelled the group of the page"
}
group() {
  kill -9 "$(at_work "*" | head -n 1)" && say "killed a subject"
}
for part in ${@:-sample group}; do
  case $part in
  sample) what=(--snakefile "$PWD/Snakefile" --configfile config/config.yaml) && both 2 sample ;;
  group) what=(--snakefile "$PWD/workflow/group.smk" --configfile config/group.yaml) && both 1 group ;;
  *) stop "expected sample or group, found $part" ;;
  esac
done
