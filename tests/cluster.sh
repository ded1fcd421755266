#!/usr/bin/env bash
# Run studies on a SLURM of three nodes on this machine, with profiles/slurm. Each node has a network and a name of
# its own (namespaces), and all share a folder whose every call takes some ms and shows names as they were a second
# ago (tests/slow_folder.py). Results must equal those of a local run byte for byte.
#
#   sample   the sample; one job is killed by kill -9, and a group job is cancelled
#   group    a group of four subjects; one of their jobs is killed
#   nodes    the same group; a node dies with its jobs as a machine does, another one is taken away
#   storage  a minute of the sample, from and to an S3 server on this machine, without a shared folder
#
# Run as root on a machine without SLURM: the script writes /etc/slurm/slurm.conf and removes it afterwards.
#
#   tests/cluster.sh [sample] [group] [nodes] [storage]
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$(realpath "${VENV:-.venv}")/bin conf=/etc/slurm/slurm.conf
moto=${MOTO_SERVER:-$bin/moto_server}
say() { echo "test-cluster: $*" >&2; }
stop() { say "$@"; exit 1; }
for part in ${@:-sample group nodes storage}; do
  case $part in sample | group | nodes | storage) ;; *) stop "expected sample, group, nodes or storage, found $part" ;; esac
done
type slurmctld slurmd munged sbatch ip fusermount3 >/dev/null || stop "install slurm-wlm, munge, iproute2 and fuse3"
"$bin/python" -c "import snakemake_executor_plugin_slurm, mfusepy" ||
  stop "run it by make test-cluster"
[ "$(id -u)" = 0 ] || stop "only root can start SLURM"
[ ! -e $conf ] || stop "$conf: this machine has a SLURM already"
work=$(mktemp -d) started=() nodes="1 2 3"
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1

# A node is a network namespace; what runs in it is all that a death of the machine would end.
die() { ip netns pids "hop$1" 2>/dev/null | xargs -r kill -KILL 2>/dev/null || true; }
up() {
  # Not by `ip netns exec`, which hides the control groups that slurmd wants to see.
  nsenter --net="/run/netns/hop$1" unshare --uts sh -c 'hostname "$0" && exec slurmd -D' "hop$1" >>"$work/hop$1.log" 2>&1 &
  disown  # bash need not tell of its death
}
end() {
  for node in $nodes; do die "$node"; done
  [ -z "${study:-}" ] || pkill -P "$study" || kill "$study" 2>/dev/null || true
  [ ${#started[@]} = 0 ] || kill "${started[@]}" 2>/dev/null || true
  fusermount3 -uz "$work/shared" 2>/dev/null || true
  for node in $nodes; do ip netns del "hop$node" 2>/dev/null || true; done
  ip link del hopdata0 2>/dev/null || true
  rm -f $conf
}
trap end EXIT

mkdir -p /etc/slurm "$work"/{state,profile,folder,shared,spool/hop1,spool/hop2,spool/hop3} && install -d -o munge /run/munge
"$bin/python" -W ignore tests/slow_folder.py "$work/folder" "$work/shared" 2 1 >"$work/slow_folder.log" 2>&1 &
started+=($!)
until mountpoint -q "$work/shared"; do kill -0 "${started[0]}" || stop "$work/slow_folder.log"; sleep 0.5; done
ip link add hopdata0 type bridge && ip addr add 10.213.0.1/24 dev hopdata0 && ip link set hopdata0 up
for node in $nodes; do
  ip netns add "hop$node" && ip link add "hopdata$node" type veth peer name eth0 netns "hop$node"
  ip link set "hopdata$node" master hopdata0 up
  ip -n "hop$node" addr add "10.213.0.1$node/24" dev eth0
  ip -n "hop$node" link set eth0 up && ip -n "hop$node" link set lo up
done
cat >$conf <<END
ClusterName=test
SlurmctldHost=$(hostname -s)(10.213.0.1)
SlurmUser=root
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool/%n
SlurmdPidFile=$work/%n.pid
SlurmctldPidFile=$work/slurmctld.pid
SlurmdTimeout=10
ReturnToService=2
JobRequeue=0
ProctrackType=proctrack/linuxproc
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=2
JobAcctGatherParams=OverMemoryKill
AccountingStorageType=accounting_storage/none
$(for node in $nodes; do echo "NodeName=hop$node NodeAddr=10.213.0.1$node CPUs=3 RealMemory=6000"; done)
PartitionName=short Nodes=ALL
END
runuser -u munge -- munged --foreground >"$work/munged.log" 2>&1 & started+=($!)
slurmctld -D >"$work/slurmctld.log" 2>&1 & started+=($!)
for node in $nodes; do up "$node"; done
all_idle() {
  for _ in $(seq 120); do
    [ "$(sinfo -h -N -o %T 2>/dev/null | grep -c '^idle$')" != 3 ] || return 0
    sleep 1
  done
  stop "$work/slurmctld.log: expected three idle nodes, found: $(sinfo -h -N -o '%N %T' | tr '\n' ' ')"
}
all_idle
say "nodes: $(sinfo -h -N -o %N | tr '\n' ' ')"
# Fill in the two values, and enable the status command for a SLURM without accounting.
sed 's/PARTITION/short/; s/ACCOUNT/lab/; s/^# slurm-status/slurm-status/' profiles/slurm/config.yaml \
  >"$work/profile/config.yaml"
run() { # folder, options
  mkdir "$work/$1" && ln -s "$PWD/data" "$work/$1/data" && cp -r config "$work/$1/config"
  sed -i '6,$d' "$work/$1/config/group.tsv" && sed -i 's/hops: .*/hops: 150/' "$work/$1/config/group.yaml"
  (cd "$work/$1" && exec "$bin/snakemake" "${what[@]}" "${@:2}") >"$work/${1##*/}.log" 2>&1 ||
    stop "$work/${1##*/}.log: expected a study that ends, found: $(tail -n 3 "$work/${1##*/}.log")"
}
holders() { # file: the processes that hold it open; those that end meanwhile are no fault
  find /proc/[0-9]*/fd -lname "$1" 2>/dev/null || true
}
at_work() { # job: the processes that hold its log open
  until holders "$work/shared/cluster/results/*/logs/$1.log" | cut -d/ -f3 | grep .; do
    kill -0 $study || exit 1
    sleep 0.2
  done
}
both() { # retries, at least; function that kills jobs
  run local --cores 2
  run shared/cluster --profile "$work/profile" --slurm-init-seconds-before-status-checks 3 & study=$!
  "$2"
  wait $study
  study=
  retries=$(grep -c "Trying to restart" "$work/cluster.log" || true)
  [ "$retries" -ge "$1" ] || stop "$work/cluster.log: expected $1 retries or more, found $retries"
  # Compare everything but times and the record of the machine.
  diff -rq -x logs -x benchmarks -x report.html -x provenance.json "$work/local/results" "$work/folder/cluster/results" >&2 ||
    stop "$work: expected the bytes of a local run, found other ones"
  say "$(grep -c "submitted with SLURM" "$work/cluster.log") submissions, $retries retries, the bytes of a local run"
  rm -r "$work"/{local,folder/cluster}
}
sample() {
  kill -9 $(at_work verdict) && say "killed the verdict"
  at_work quality >/dev/null
  scancel "$(squeue -h -o "%i %k" | sed -n 's/ rule_page.*//p')" && say "cancelled the group of the page"
}
group() {
  kill -9 "$(at_work "*" | head -n 1)" && say "killed a subject"
}
node_at_work() { # besides these: a node that has begun a job
  until squeue -h -t R -o %N | grep -v "${1:-none}" | head -n 1 | grep .; do
    kill -0 $study || exit 1
    sleep 0.2
  done
}
nodes() {
  at_work "*" >/dev/null
  local first second
  first=$(node_at_work) && die "${first#hop}" && say "$first died with its jobs"
  second=$(node_at_work "$first")
  scontrol update "NodeName=$second" State=DOWN Reason=taken && say "$second was taken away"
  # With a star, since it does not answer.
  until [ "$(sinfo -h -N -n "$first" -o %T)" = "down*" ]; do sleep 1; done
  say "SLURM has noticed the death of $first"
  up "${first#hop}"
  # Its slurmd may have reported, so that it is back already.
  scontrol update "NodeName=$second" State=RESUME 2>/dev/null || true
}
storage() {
  [ -x "$moto" ] && "$bin/python" -c "import snakemake_storage_plugin_s3" ||
    stop "run it by make test-cluster"
  VENV="$bin/.." "$bin/python" tests/object_storage.py "$moto" "$work/storage"
}
# Not in lists of &&, in which bash goes on after a fault.
group_of_four=(--snakefile "$PWD/workflow/group.smk" --configfile config/group.yaml)
for part in ${@:-sample group nodes storage}; do
  case $part in
  sample) what=(--snakefile "$PWD/Snakefile" --configfile config/config.yaml); both 2 sample ;;
  group) what=("${group_of_four[@]}"); both 1 group ;;
  nodes) what=("${group_of_four[@]}"); both 2 nodes; all_idle ;;
  storage) storage ;;
  esac
done
