#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# How the shipped weights were made: octrees of the scenes in PATCHNET_SCENES and of rooms and gardens composed of the
# furniture libraries for training (docs/lab/furnished-scenes.md), a training run that draws its samples from them, and the
# error estimator.
#
#   PATCHNET_SCENES=/path/to/scenes training/shipped_weights.sh LIBRARIES-FOLDER WORK-FOLDER
#
# Sources for testing (LDraw, the sports car, Reallusion, this project's own scenes) are excluded from training. A second
# run keeps existing files and resumes the training.
set -euo pipefail
scenes=${PATCHNET_SCENES:?set PATCHNET_SCENES to the folder of the scenes}
libraries=${1:?give the folder of the furniture libraries}
work=${2:?give a folder to work in}
patchnet=${PATCHNET:-patchnet}
mkdir -p "$work/octrees" "$work/scenes"

furnish() { # NAME KIND SEED LIBRARIES...
    local out=$work/scenes/$1.glb kind=$2 seed=$3
    shift 3
    [ -e "$out" ] || "$patchnet" lab furnish "${@/#/$libraries/}" --kind "$kind" --seed "$seed" --out "$out"
}

octree() { # NAME SCENE OPTIONS...
    local out=$work/octrees/$1.safetensors scene=$2
    shift 2
    [ -e "$out" ] || "$patchnet" octree "$scene" --sides one --out "$out" "$@"
}

blendswap=(BlendSwap-CC-0.sh3f BlendSwap-CC-BY.sh3f)
furnish room-1 interior 1 Scopia.sh3f
furnish room-2 interior 2 "${blendswap[@]}"
furnish room-3 interior 3 Scopia.sh3f
furnish room-4 interior 4 "${blendswap[@]}"
furnish garden-5 garden 5 Scopia.sh3f
furnish garden-6 garden 6 "${blendswap[@]}"

octree room-1 "$work/scenes/room-1.glb" --depth 10 --light cycles --without ceiling
octree room-2 "$work/scenes/room-2.glb" --depth 10 --light cycles --without ceiling
octree room-3 "$work/scenes/room-3.glb" --depth 9 --light cycles --without ceiling
octree room-4-turned "$work/scenes/room-4.glb" --depth 10 --light two-lights --rotate 4
octree garden-5 "$work/scenes/garden-5.glb" --depth 10 --light cycles
octree garden-6 "$work/scenes/garden-6.glb" --depth 9 --light cycles
octree garden-6-turned "$work/scenes/garden-6.glb" --depth 10 --light two-lights --rotate 6
octree sponza "$scenes/sponza_crytek.glb" --depth 9 --light cycles --max-samples 16
octree sponza-turned "$scenes/sponza_crytek.glb" --depth 10 --light two-lights --rotate 1
octree clinic "$scenes/bim_clinic.glb" --depth 9 --light cycles
octree clinic-turned "$scenes/bim_clinic.glb" --depth 10 --light two-lights --rotate 1
octree ducts "$scenes/bim_clinic.glb" --depth 10 --light two-lights --without architectural,structural
octree ducts-turned "$scenes/bim_clinic.glb" --depth 9 --light cycles --without architectural,structural --rotate 1
octree san-miguel "$scenes/san_miguel.glb" --depth 10 --light cycles \
    --without sun_light,fill_light,baked:negro,baked:banqueta,calle --bisect z 0.76
octree san-miguel-turned "$scenes/san_miguel.glb" --depth 10 --light two-lights --rotate 1

# Scenes for validation only.
unseen=(courtyard furnished-room furnished-garden shuttle station sports-car)
"$patchnet" lab evaluate --scenes "$(IFS=,; echo "${unseen[*]}")" --prepare --out "$work/unseen"
for scene in "${unseen[@]}"; do
    cp -n "$work/unseen/octrees/$scene"-????????????????.safetensors "$work/unseen/$scene.safetensors"
done

[ -d "$work/unseen-samples" ] ||
    "$patchnet" lab dataset "$work"/unseen/*.safetensors --samples 240000 --seed 1 --out "$work/unseen-samples"
resume=$([ -e "$work/run/checkpoint.pt" ] && echo --resume || true)
"$patchnet" lab train "$work"/octrees/*.safetensors --fresh --validate "$work/unseen-samples" --preset improved \
    --encoder-width 128 --passes 256000000 --out "$work/run" $resume

# The error estimator, trained on these weights' predictions for the octrees.
"$patchnet" lab train-plus "$work"/octrees/*.safetensors --weights "$work/run/patchnet.safetensors" --out "$work/plus"
