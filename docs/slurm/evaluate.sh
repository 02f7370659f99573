#!/bin/bash
# PatchNet's evaluation on a Slurm cluster, as three dependent jobs: octrees and codes, an array of shares of the frames,
# results and report. Run it on a login node; finished parts are skipped.
#
#   PATCHNET_SCENES=/data/scenes SHARES=16 docs/slurm/evaluate.sh OUT --scenes all --every 10
#
# OUT: folder shared by all nodes, then arguments of `patchnet lab evaluate`. SHARES: tasks of the array (8).
# PATCHNET: the command, if it is not on the path. SBATCH_OPTIONS: more options of sbatch, such as a partition.
set -euo pipefail
out=$1
shift
mkdir -p "$out"
words="${PATCHNET:-patchnet} $(printf '%q ' lab evaluate "$@" --out "$out")"
shares=${SHARES:-8}
read -ra options <<<"${SBATCH_OPTIONS:-}"

submit() { # NAME COMMAND OPTION...    print the job's number
    sbatch --parsable --kill-on-invalid-dep=yes --job-name "patchnet-$1" --output "$out/slurm-%x-%A-%a.log" "${options[@]}" "${@:3}" --wrap "$2"
}

# Slurm cancels the jobs that depend on a failed one.
prepared=$(submit prepare "$words --prepare")
framed=$(submit frames "$words --processes \${SLURM_CPUS_ON_NODE:-1} --part \$SLURM_ARRAY_TASK_ID/$shares" \
    --array "1-$shares" --dependency "afterok:$prepared")
submit report "$words" --dependency "afterok:$framed"
