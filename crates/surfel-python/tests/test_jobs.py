"""Job files of `surfel jobs` by the engines' own parsers, and run by those that run on one machine. Run by `cargo xtask
test --full`, which installs them."""

import json
import os
import pathlib
import shutil
import subprocess
import sys

import conftest
import pytest

pytestmark = pytest.mark.engines
PIECES = {
    "frames": ["--frames=5", "--tasks=2", "-o", "f {frame}.png"],
    "tiles": ["--tiles=3", "-o", "whole.png"],
}


@pytest.fixture
def folder(tmp_path):
    """A folder whose name needs quotes, with a small scene."""
    folder = tmp_path / "my scans"
    folder.mkdir()
    points, colors = conftest.sphere(500)
    conftest.ply(folder / "ball.ply", points, colors, normals=points, radii=points[:, 0] * 0 + 0.1)
    return folder


@pytest.fixture(params=PIECES)
def job(request, folder, program):
    """Makes a job for an engine."""
    def make(engine):
        return program(folder, "jobs", "ball.ply", engine, *PIECES[request.param], "--", "--size=48x36").decode()

    make.wanted = ["whole.png"] if request.param == "tiles" else [f"f {i:04}.png" for i in range(5)]
    return make


def run(folder, *words):
    """Runs a tool of this environment, which finds the program."""
    tools, surfel = pathlib.Path(sys.executable).parent, pathlib.Path(conftest.find_program()).resolve().parent
    environment = {**os.environ, "PATH": os.pathsep.join([str(surfel), str(tools), os.environ["PATH"]])}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def drawn_as_by_one_command(folder, program, job):
    flags = ["--size=48x36", "--turntable", "--frames=5"] if len(job.wanted) > 1 else ["--size=48x36"]
    name = "one {frame}.png" if len(job.wanted) > 1 else "one.png"
    program(folder, "ball.ply", *flags, "-o", name)
    for i, wanted in enumerate(job.wanted):
        one = name.replace("{frame}", f"{i:04}")
        compared = json.loads(program(folder, "compare", one, wanted, "--json"))
        assert compared["max_abs"] == 0, wanted


def test_openjd_runs_jobs(folder, job, program):
    pytest.importorskip("openjd.cli")
    (folder / "job.json").write_text(job("--openjd"))
    run(folder, "openjd", "check", "job.json")
    run(folder, "openjd", "run", "job.json", *(["--step", "stitch", "--run-dependencies"] if len(job.wanted) == 1 else []))
    drawn_as_by_one_command(folder, program, job)
    broken = json.loads((folder / "job.json").read_text())
    broken["steps"][0]["script"]["actions"]["onRuns"] = {}
    (folder / "broken.json").write_text(json.dumps(broken))
    with pytest.raises(AssertionError, match="onRuns"):
        run(folder, "openjd", "check", "broken.json")


def test_snakemake_runs_jobs(folder, job, program):
    pytest.importorskip("snakemake")
    (folder / "Snakefile").write_text(job("--snakemake"))
    run(folder, "snakemake", "--cores", "2", "--quiet")
    drawn_as_by_one_command(folder, program, job)


def test_kubernetes_takes_jobs(job):
    validate = pytest.importorskip("kubernetes_validate")
    manifest = json.loads(job("--k8s"))
    validate.validate(manifest, validate.latest_version(), strict=True)
    manifest["spec"]["completion"] = manifest["spec"].pop("completions")
    with pytest.raises(validate.ValidationError):
        validate.validate(manifest, validate.latest_version(), strict=True)


def test_bash_reads_slurms_scripts(folder, job):
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    text = job("--slurm")
    (folder / "job.sh").write_text(text)
    run(folder, "bash", "-n", "job.sh")
    # Slurm reads options before the first command, and nothing after it.
    lines = text.splitlines()
    options = [i for i, line in enumerate(lines) if line.startswith("#SBATCH --")]
    first = next(i for i, line in enumerate(lines) if line and not line.startswith("#"))
    assert lines[0] == "#!/bin/bash" and options and max(options) < first
    if shutil.which("sbatch"):
        run(folder, "sbatch", "--test-only", "job.sh")
