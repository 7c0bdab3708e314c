"""The real binary, in a namespace of its own."""

import os
import pathlib
import shutil
import subprocess
import time

import pytest

ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope="session")
def program() -> str:
    found = os.environ.get("HAPFIC") or shutil.which("hapfic") or str(ROOT / "target/release/hapfic")
    if not os.path.exists(found):
        pytest.fail(f"found no {found}, expected a release build. Hint: cargo build --release, or HAPFIC=PATH")
    return found


@pytest.fixture
def stack(program, tmp_path, monkeypatch):
    """Starts the program in a folder and with registrations of its own; kills what is left."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    (tmp_path / "runtime").mkdir()
    started = []

    def start(*arguments: str) -> subprocess.Popen:
        process = subprocess.Popen(
            [program, *arguments], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


@pytest.fixture
def wait_for():
    def wait(condition, seconds: float = 20.0):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if (found := condition()) not in (None, False, []):
                return found
            time.sleep(0.02)
        pytest.fail("did not come in time")

    return wait
