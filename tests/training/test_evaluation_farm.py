# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluations as an Open Job Description job and as a Slurm job array."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.training.benchmarks.shells import octree_of_shells

pytest.importorskip("matplotlib")
ROOT = Path(__file__).resolve().parents[2]
PATCHNET = f"{sys.executable} -m patchnet"
SLURM = ("slurmctld", "slurmd", "sbatch", "squeue", "sinfo")
SMALL = {"Frames": "24", "Every": "4", "Width": "24", "Height": "16"}


@pytest.fixture
def octree(tmp_path):
    path = tmp_path / "shells.safetensors"
    save_octree(octree_of_shells(5000), path)
    return path


def results(out: Path) -> dict:
    return json.loads((out / "results.json").read_text(encoding="utf-8"))["scenes"]["shells"]


@pytest.mark.skipif(os.name == "nt", reason="the tasks are shell scripts")
def test_open_job_description(octree, tmp_path):
    pytest.importorskip("openjd.cli", reason="openjd-cli is not installed")
    out = tmp_path / "out"
    values = SMALL | {
        "Scenes": "", "Octrees": octree, "OutputFolder": out, "Shares": "2", "Command": PATCHNET, "Options": "--seed 3",
    }  # fmt: skip
    words = [word for name, value in values.items() for word in ("-p", f"{name}={value}")]
    template = str(ROOT / "docs" / "openjd" / "evaluate.yaml")
    words = [sys.executable, "-m", "openjd", "run", template, "--step", "Report", "--run-dependencies", *words]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert results(out)["frames"] == 6 and (out / "tables.md").is_file()
    assert json.loads((out / "results.json").read_text(encoding="utf-8"))["settings"]["seed"] == 3


@pytest.fixture
def slurm(tmp_path):
    """Environment of a Slurm of one node, which ends with the test."""
    missing = [name for name in SLURM if shutil.which(name) is None]
    if missing or not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip(
            f"a Slurm of one node needs root and the package slurm-wlm (missing: {', '.join(missing) or 'root'})"
        )
    host = socket.gethostname().partition(".")[0]
    for folder in ("state", "spool"):
        (tmp_path / folder).mkdir()
    ports = [free_port() for _ in range(2)]
    (tmp_path / "slurm.conf").write_text(f"""
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/none
CredType=cred/none
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={tmp_path}/state
SlurmdSpoolDir={tmp_path}/spool
SlurmctldPidFile={tmp_path}/slurmctld.pid
SlurmdPidFile={tmp_path}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
MailProg=/bin/true
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
""")
    environment = os.environ | {"SLURM_CONF": str(tmp_path / "slurm.conf")}
    logs = [tmp_path / f"{name}.log" for name in SLURM[:2]]
    daemons = [start(name, log, environment) for name, log in zip(SLURM, logs, strict=False)]
    try:
        wait_for(lambda: "idle" in said(environment, "sinfo", "-h", "-o", "%t"), 30, daemons, logs)
        yield environment
    finally:
        for daemon in daemons:
            daemon.terminate()
            daemon.wait(10)


def start(name: str, log: Path, environment: dict) -> subprocess.Popen:
    with log.open("wb") as file:
        return subprocess.Popen([name, "-D"], env=environment, stdout=file, stderr=file)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def said(environment: dict, *words: str) -> str:
    return subprocess.run(words, env=environment, capture_output=True, text=True, check=False).stdout


def wait_for(is_so, seconds: float, daemons=(), logs=()) -> None:
    end = time.monotonic() + seconds
    while not is_so():
        if time.monotonic() > end or any(daemon.poll() is not None for daemon in daemons):
            texts = [log.read_text(errors="replace")[-400:] for log in logs]
            if daemons:
                pytest.skip(f"Slurm does not start here: {texts}")
            pytest.fail("the jobs did not end in time")
        time.sleep(0.5)


def test_slurm_job_array(slurm, octree, tmp_path):
    out = tmp_path / "out"
    words = [ROOT / "docs" / "slurm" / "evaluate.sh", out, octree]
    words += ["--frames", "24", "--every", "2", "--size", "24", "16"]
    done = subprocess.run(
        list(map(str, words)),
        env=slurm | {"PATCHNET": PATCHNET, "SHARES": "2"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stdout.strip().isdecimal(), done.stdout + done.stderr
    wait_for(lambda: not said(slurm, "squeue", "-h"), 300)
    logs = {path.name: path.read_text() for path in out.glob("slurm-*.log")}
    assert (out / "results.json").is_file(), logs
    assert results(out)["frames"] == 12
    assert sum(" of frames" in text and "finished" in text for text in logs.values()) == 2, logs
