# SPDX-License-Identifier: BSD-3-Clause
# Functions for bash: a Slurm of this machine alone, one node with two slots,
# that listens on the loopback interface only. Everything lies in one folder.

# start_slurm FOLDER: exports SLURM_CONF.
start_slurm() {
  local folder=$1 host port user memory_mb
  host=$(hostname -s)
  user=$(id -un)
  memory_mb=$(slurmd -C | sed -n "s/.*RealMemory=\([0-9]*\).*/\1/p")
  port=$((20000 + RANDOM % 20000))
  mkdir -p "$folder"/{state,spool}
  chmod 700 "$folder"
  (umask 077 && head -c 1024 /dev/urandom >"$folder/munge.key")
  munged --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
    --pid-file="$folder/munged.pid" --log-file="$folder/munged.log" \
    --seed-file="$folder/munged.seed" --num-threads=2 --force
  cat >"$folder/slurm.conf" <<EOF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
MinJobAge=3600
SchedulerParameters=sched_interval=1,batch_sched_delay=0
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 RealMemory=$memory_mb State=UNKNOWN
PartitionName=test Nodes=$host Default=YES MaxTime=INFINITE State=UP OverSubscribe=NO
EOF
  export SLURM_CONF="$folder/slurm.conf"
  slurmctld -f "$SLURM_CONF"
  slurmd -f "$SLURM_CONF"
  for _ in $(seq 60); do
    if [ "$(sinfo -h -o %T 2>/dev/null)" = idle ]; then return 0; fi
    sleep 0.5
  done
  echo "Slurm does not start:" >&2
  tail -n 20 "$folder"/{munged,slurmctld,slurmd}.log >&2
  return 1
}

# stop_slurm FOLDER: ends jobs and daemons.
stop_slurm() {
  local folder=$1 daemon
  scancel --user="$(id -un)" 2>/dev/null || true
  for daemon in slurmd slurmctld munged; do
    [ -s "$folder/$daemon.pid" ] || continue
    kill "$(cat "$folder/$daemon.pid")" 2>/dev/null || true
  done
  sleep 1
}
