#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# Networks of the paper on scenes of the catalogue, each on the same budget: one of each scene, called SCENE, one of all
# others, without-SCENE, and of all scenes but the last one: with one and three levels of look-ahead, look-ahead-1 and
# look-ahead-3, and with the encoders that convolve, conv3d and voxception.
#
#   PATCHNET_SCENES=/path/to/scenes training/networks_of_paper.sh WORK-FOLDER SCENE,SCENE SAMPLES PASSES [OPTIONS]
#
# SAMPLES are those of each scene, PASSES those of each network, OPTIONS those of `patchnet lab train`, for example
# --network paper --loss absolute. The variable KINDS has the networks to train (scene without look-ahead encoders).
# Prints the errors of each network on all scenes. A second run keeps existing files and resumes trainings.
set -euo pipefail
work=${1:?give a folder to work in}
IFS=, read -ra scenes <<<"${2:?give scenes of the catalogue, with commas between}"
samples=${3:?give the samples of each scene}
passes=${4:?give the passes of each network}
options=("${@:5}")
kinds=" ${KINDS:-scene without look-ahead encoders} "
patchnet=${PATCHNET:-patchnet}
last=${scenes[-1]}

"$patchnet" lab evaluate --scenes "$2" --prepare --out "$work"
octrees=()
for scene in "${scenes[@]}"; do
    cp -n "$work/octrees/$scene"-????????????????.safetensors "$work/$scene.safetensors"
    octrees+=("$work/$scene.safetensors")
done

but() { # SCENE
    local each
    for each in "${scenes[@]}"; do [ "$each" = "$1" ] || echo "$each"; done
}

network() { # NAME LOOK-AHEAD SCENES OPTIONS...
    local run=$work/networks/$1 drawn=$work/samples-$2 files=() scene
    [ -e "$drawn/$last.samples.safetensors" ] ||
        "$patchnet" lab dataset "${octrees[@]}" --samples $((samples * ${#scenes[@]})) --lookahead "$2" --out "$drawn"
    for scene in $3; do files+=("$drawn/$scene.samples.safetensors"); done
    "$patchnet" lab train "${files[@]}" --passes "$passes" "${@:4}" "${options[@]}" --out "$run" \
        $([ -e "$run/checkpoint.pt" ] && echo --resume)
    "$patchnet" lab validate "$drawn" --weights "$run/patchnet.safetensors"
}

for scene in "${scenes[@]}"; do
    [[ $kinds != *" scene "* ]] || network "$scene" 2 "$scene"
done
for scene in "${scenes[@]}"; do
    [[ $kinds != *" without "* ]] || network "without-$scene" 2 "$(but "$scene")"
done
for levels in 1 3; do
    [[ $kinds != *" look-ahead "* ]] || network "look-ahead-$levels" "$levels" "$(but "$last")"
done
for encoder in conv3d voxception; do
    [[ $kinds != *" encoders "* ]] || network "$encoder" 2 "$(but "$last")" --encoder "$encoder"
done
