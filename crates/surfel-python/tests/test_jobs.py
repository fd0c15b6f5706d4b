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
    "shares": ["--tasks=3", "-o", "the land.copc.laz"],
}
LAND = ["land 0.las", "land 1.las"]
# What puts pieces together.
JOINED = {"tiles": "stitch", "shares": "merge"}


@pytest.fixture
def folder(tmp_path):
    """A folder whose name needs quotes, with a small scene and two tiles of land."""
    folder = tmp_path / "my scans"
    folder.mkdir()
    points, colors = conftest.sphere(500)
    conftest.ply(folder / "ball.ply", points, colors, normals=points, radii=points[:, 0] * 0 + 0.1)
    for name, land in zip(LAND, conftest.land(2, 50_000)):
        conftest.las(folder / name, land)
    return folder


@pytest.fixture(params=PIECES)
def job(request, folder, program):
    """Makes a job for an engine."""
    def make(engine):
        inputs, flags = (LAND, ["--threads=1"]) if request.param == "shares" else (["ball.ply"], ["--size=48x36"])
        return program(folder, "jobs", *inputs, engine, *PIECES[request.param], "--", *flags).decode()

    make.wanted = [f"f {i:04}.png" for i in range(5)] if request.param == "frames" else [PIECES[request.param][-1]]
    make.joined = JOINED.get(request.param)
    return make


def run(folder, *words):
    """Runs a tool of this environment, which finds the program."""
    tools, surfel = pathlib.Path(sys.executable).parent, pathlib.Path(conftest.find_program()).resolve().parent
    environment = {**os.environ, "PATH": os.pathsep.join([str(surfel), str(tools), os.environ["PATH"]])}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def made_as_by_one_command(folder, program, job):
    if job.joined == "merge":
        program(folder, "convert", *LAND, "-o", "one.copc.laz")
        assert (folder / "one.copc.laz").read_bytes() == (folder / job.wanted[0]).read_bytes()
        return
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
    run(folder, "openjd", "run", "job.json", *(["--step", job.joined, "--run-dependencies"] if job.joined else []))
    made_as_by_one_command(folder, program, job)
    broken = json.loads((folder / "job.json").read_text())
    broken["steps"][0]["script"]["actions"]["onRuns"] = {}
    (folder / "broken.json").write_text(json.dumps(broken))
    with pytest.raises(AssertionError, match="onRuns"):
        run(folder, "openjd", "check", "broken.json")


def test_snakemake_runs_jobs(folder, job, program):
    pytest.importorskip("snakemake")
    (folder / "Snakefile").write_text(job("--snakemake"))
    run(folder, "snakemake", "--cores", "2", "--quiet")
    made_as_by_one_command(folder, program, job)


def test_kubernetes_takes_jobs(job):
    validate = pytest.importorskip("kubernetes_validate")
    manifest = json.loads(job("--k8s"))
    manifests = manifest["items"] if job.joined else [manifest]
    assert len({one["metadata"]["name"] for one in manifests}) == (2 if job.joined else 1)
    for one in manifests:
        validate.validate(one, validate.latest_version(), strict=True)
    spec = manifests[0]["spec"]
    spec["completion"] = spec.pop("completions")
    with pytest.raises(validate.ValidationError):
        validate.validate(manifests[0], validate.latest_version(), strict=True)


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
