"""A client of a running stack."""

import pytest

import hapfic
from hapfic.messages import Mode


def test_looks_and_changes(stack, wait_for):
    process = stack("run", "floor", "--duration", "20", "--realtime", "off", "--log", "run.mcap")
    wait_for(hapfic.runs)
    with hapfic.Client() as client:
        assert client.run.scenario == "floor"
        wait_for(lambda: client.receive("state"))
        ticks = [state.tick for state in client.follow("state", seconds=0.5)]
        assert len(ticks) > 200 and all(b == a + 1 for a, b in zip(ticks, ticks[1:]))
        assert "in force from tick" in client.set(desired_force=[0.0, 0.0, 33.0])
        wait_for(lambda: client.get("desired_force") == {"desired_force_n": [0, 0, 33]})
        with pytest.raises(hapfic.Refused, match="stiffness"):
            client.set(stiffness=[-1.0, 1.0, 1.0])
        assert client.status()["run"] == client.run.name
        client.estop()
        wait_for(lambda: client.newest("command").mode == Mode.STOPPED)
        client.rearm()
        wait_for(lambda: client.newest("command").mode == Mode.ACTIVE)
        client.stop()
    assert process.wait(20) is not None


def test_no_run_is_one_clear_error(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(hapfic.HapficError, match="found none, expected one running stack"):
        hapfic.Client()
