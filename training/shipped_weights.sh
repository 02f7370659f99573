#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# How the shipped weights were made: octrees of the scenes in PATCHNET_SCENES, samples of them, one training run.
#
#   PATCHNET_SCENES=/path/to/scenes training/shipped_weights.sh WORK-FOLDER
#
# The demo scene takes no part. Octrees that exist are kept and the training resumes, so the script can be run again.
set -euo pipefail
scenes=${PATCHNET_SCENES:?set PATCHNET_SCENES to the folder of the scenes}
work=${1:?give a folder to work in}
patchnet=${PATCHNET:-patchnet}
mkdir -p "$work/octrees"

octree() { # NAME SCENE OPTIONS...
    local out=$work/octrees/$1.safetensors scene=$scenes/$2
    shift 2
    [ -e "$out" ] || "$patchnet" octree "$scene" --out "$out" "$@"
}

octree sponza-cycles sponza_crytek.glb --depth 9 --light cycles --samples 16 --texel-voxels 1
octree sponza-turned sponza_crytek.glb --depth 10 --light two-lights --rotate 1
octree shuttle ldraw_space_shuttle.glb --depth 9 --light two-lights
octree shuttle-turned ldraw_space_shuttle.glb --depth 10 --light two-lights --rotate 2
octree station ldraw_iss.glb --depth 9 --light two-lights
octree station-turned ldraw_iss.glb --depth 9 --light two-lights --rotate 1
octree car sports_car.glb --depth 9 --light two-lights
octree car-turned sports_car.glb --depth 9 --light two-lights --rotate 1
octree clinic bim_clinic.glb --depth 10 --light two-lights
octree clinic-turned bim_clinic.glb --depth 9 --light two-lights --rotate 1
octree ducts bim_clinic.glb --depth 10 --light two-lights --without architectural,structural
octree ducts-turned bim_clinic.glb --depth 10 --light two-lights --without architectural,structural --rotate 1
octree san-miguel san_miguel.glb --depth 10 --light two-lights
octree san-miguel-turned san_miguel.glb --depth 10 --light two-lights --rotate 1

[ -d "$work/samples" ] || "$patchnet" dataset "$work"/octrees/*.safetensors --samples 16000000 --out "$work/samples"
resume=$([ -e "$work/run/checkpoint.pt" ] && echo --resume || true)
"$patchnet" train "$work/samples" --preset improved --network paper --loss absolute --passes 128000000 \
    --out "$work/run" $resume
