#!/usr/bin/env bash
# A real Slurm on this machine, of one node, for as long as this takes: submits the array that
# `druse plan --emit slurm` writes, kills and requeues one brick, waits for the merge, and compares
# the content hash with that of the run in memory.
#
#     tests/clients/slurm.sh DRUSE DIRECTORY
#
# Needs root, and the packages slurm-wlm and munge of Debian 12. Nothing outside DIRECTORY is changed.
set -euo pipefail
druse=$(realpath "$1")
mkdir -p "$2"
place=$(realpath "$2")
rm -rf "${place:?}"/*
daemons=()
finish() {
    for pid in "${daemons[@]}"; do kill "$pid" 2>/dev/null || true; done
    wait 2>/dev/null || true
}
trap finish EXIT

# Munge: a key and a socket of our own.
mkdir -m 700 "$place/munge"
head -c 1024 /dev/urandom >"$place/munge/key"
chmod 600 "$place/munge/key"
socket=$place/munge/socket
munged --foreground --force --key-file="$place/munge/key" --socket="$socket" --pid-file="$place/munge/pid" \
    --log-file="$place/munge/log" --seed-file="$place/munge/seed" >"$place/munge/out" 2>&1 &
daemons+=($!)

mkdir "$place/state" "$place/spool"
host=$(hostname -s)
export SLURM_CONF=$place/slurm.conf
cat >"$SLURM_CONF" <<END
ClusterName=druse
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$socket
CredType=cred/munge
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=requeue_delay=0,batch_sched_delay=0,sched_interval=2
SwitchType=switch/none
MpiDefault=none
JobCompType=jobcomp/none
ReturnToService=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(($(free -m | awk '/^Mem:/ {print $2}') / 2)) State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
END
sleep 1
slurmctld -D >"$place/slurmctld.out" 2>&1 &
daemons+=($!)
slurmd -D -N "$host" >"$place/slurmd.out" 2>&1 &
daemons+=($!)
until [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; do
    if [ $((waited = ${waited:-0} + 1)) -gt 60 ]; then
        echo "the node does not come up:" >&2
        sinfo >&2 || true
        tail -n 20 "$place"/*.log "$place"/*.out "$place/munge/out" >&2
        exit 1
    fi
    sleep 0.5
done

cat >"$place/part.toml" <<END
druse = 1
unit = "mm"
[cell.strut]
graph = "bcc"
volume_fraction = 0.15
[scaffold]
box = { size = [5, 5, 5], cell_size = 2.5 }
[tiling]
cell = "strut"
[band]
voxel_size = 0.05
[[op]]
mean = 1
[[output]]
vdb = "part.vdb"
END
cd "$place"
"$druse" run part.toml --quiet --out whole
"$druse" plan part.toml -o part.json --bricks 2 --threads 1 --emit slurm
# Bricks take a second at least, so that one can be caught at work.
cat >slow <<END
#!/bin/sh
sleep 1
exec "$druse" "\$@"
END
chmod +x slow
DRUSE=$place/slow sh part.slurm.sh | tee submitted
merge=$(sed -n 's/^Submitted batch job \([0-9]*\).*/\1/p' submitted | tail -n 1)
# Takes a running brick from its node and puts it back into the queue.
until running=$(squeue -h -t R -o %A | grep -v "^$merge$" | head -n 1) && [ -n "$running" ]; do sleep 0.2; done
scontrol requeue "$running"
echo "killed and requeued $running"
# It would wait two minutes for its node to be clean.
until scontrol update JobId="$running" StartTime=now 2>/dev/null; do sleep 0.5; done
while [ -n "$(squeue -h -j "$merge" 2>/dev/null)" ]; do sleep 1; done
hash_of() { "$druse" info --json "$1" | python3 -c 'import json, sys; print(json.load(sys.stdin)["content_hash"])'; }
if [ ! -f part.vdb ]; then
    cat slurm-*.out >&2
    exit 1
fi
[ "$(hash_of part.vdb)" = "$(hash_of whole/part.vdb)" ]
bricks=$(ls part.bricks/*.leaves | wc -l)
echo "figure: Slurm $(sinfo --version | cut -d' ' -f2), array of $bricks bricks, one killed and requeued | content hash equal | equal"
