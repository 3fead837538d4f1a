"""Runs with their events."""

import gc
import json
import signal
import subprocess
import sys
import threading
import time

import palpate
import pytest
from conftest import EXAMPLE, ROOT


def presses_of(events):
    return [event for event in events if "event" not in event]


def test_the_events_are_the_lines_of_the_command(program, recipe, tmp_path):
    events = palpate.run(recipe(30), out=tmp_path / "ours", seed=5)
    heard = list(events)
    command = [program, "run", recipe(30), "--out", tmp_path / "its", "--seed", "5", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert presses_of(heard) == [json.loads(line) for line in done.stdout.splitlines()]
    assert list(presses_of(heard)[0]) == list(json.loads(done.stdout.splitlines()[0]))
    assert heard[0]["event"] == "ready" and {device["role"] for device in heard[0]["devices"]} == {"stage", "load_cell", "array"}
    assert heard[-1] == {"event": "ended", "status": "complete", "out": events.out}
    assert events.planned == 30 and events.out == tmp_path / "ours"
    assert list(events) == []


def test_package_record_and_program_name_one_commit(program, recipe, tmp_path):
    list(palpate.run(recipe(1), out=tmp_path / "run"))
    session = palpate.load(tmp_path / "run").manifest["sessions"][0]
    assert session.get("commit") == palpate.__commit__
    # the program may have been built before a file was changed, the package after
    commit = f" ({palpate.__commit__.removesuffix('-dirty')})" if palpate.__commit__ else ""
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
    assert version.strip().replace("-dirty", "") == f"palpate {palpate.__version__}{commit}"


def test_a_consumer_that_begins_late_gets_every_press(recipe, tmp_path):
    events = palpate.run(recipe(3000), out=tmp_path / "run", durability="fast")
    while json.loads((tmp_path / "run" / "manifest.json").read_text())["presses_done"] < 3000:
        time.sleep(0.05)
    heard = list(events)
    assert [press["press"] for press in presses_of(heard)] == list(range(3000))
    assert len(heard) < 3000 + 300


def ending(run):
    loaded = palpate.load(run)
    return loaded.manifest["status"], len(loaded)


@pytest.mark.parametrize("how", ["delete", "close", "with"])
def test_events_that_are_dropped_park_the_rig(recipe, tmp_path, how):
    events = palpate.run(recipe(20_000), out=tmp_path / "run")
    next(event for event in events if "event" not in event)
    if how == "delete":
        del events
        gc.collect()
    elif how == "close":
        events.close()
        assert list(events) == []
    else:
        with events:
            pass
    status, presses = ending(tmp_path / "run")
    assert status == "stopped" and 1 <= presses < 20_000


def test_a_stop_ends_after_the_press(recipe, tmp_path):
    events = palpate.run(recipe(20_000), out=tmp_path / "run")
    next(event for event in events if "event" not in event)
    events.stop()
    assert list(events)[-1]["status"] == "stopped"


def test_a_real_time_run_shows_its_force_and_leaves_other_threads_alone(recipe, tmp_path):
    with palpate.run(recipe(50), out=tmp_path / "run", pace=20) as events:
        next(event for event in events if "event" not in event)
        assert abs(events.force_n) < 5


def test_no_signal_handler_is_installed(recipe, tmp_path):
    before = [signal.getsignal(number) for number in signal.valid_signals()]
    list(palpate.run(recipe(3), out=tmp_path / "run"))
    assert [signal.getsignal(number) for number in signal.valid_signals()] == before


def test_ctrl_c_is_pythons_and_the_rig_is_parked(recipe, tmp_path):
    text = f"""
import palpate, sys
for event in palpate.run({str(recipe(100_000))!r}, out={str(tmp_path / 'run')!r}, durability="fast"):
    if "event" not in event and event["press"] == 3:
        print("pressed", flush=True)
"""
    process = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "pressed\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in errors
    assert ending(tmp_path / "run")[0] == "stopped"


def test_a_program_that_ends_parks_the_rig(recipe, tmp_path):
    text = f"""
import builtins, palpate
builtins.kept = palpate.run({str(recipe(100_000))!r}, out={str(tmp_path / 'run')!r}, durability="fast")
next(kept)
"""
    subprocess.run([sys.executable, "-c", text], check=True, timeout=60)
    assert ending(tmp_path / "run")[0] == "stopped"


def test_one_thread_waits_at_a_time(recipe, tmp_path):
    with palpate.run(recipe(20_000), out=tmp_path / "run", pace=1) as events:
        waiting = threading.Thread(target=lambda: [event for event in events if "event" not in event])
        waiting.start()
        time.sleep(0.3)
        with pytest.raises(RuntimeError, match="another thread"):
            next(events)
        events.close()
        waiting.join(60)
        assert not waiting.is_alive()


def test_bad_input_is_refused_before_anything_moves(tmp_path, recipe):
    with pytest.raises(palpate.UsageError, match="no-such.toml") as refused:
        palpate.run("no-such.toml", out=tmp_path / "run")
    assert refused.value.code == 2 and "help: give an existing file or a shipped one" in str(refused.value)
    (tmp_path / "bad.toml").write_text('name = "bad"\n[press]\nforce = 1\n')
    with pytest.raises(palpate.UsageError, match=r"bad.toml:3:\d+: "):
        palpate.run(tmp_path / "bad.toml", out=tmp_path / "run")
    with pytest.raises(palpate.UsageError, match="invalid value"):
        palpate.run(recipe(3), out=tmp_path / "run", strategy="brutal")
    assert not (tmp_path / "run").exists()
    (tmp_path / "run").mkdir()
    with pytest.raises(palpate.UsageError, match="exists"):
        palpate.run(recipe(3), out=tmp_path / "run")


def test_a_device_that_fails_is_an_exception_with_the_commands_text(program, recipe, tmp_path):
    rig = ROOT / "rigs" / "esp301.toml"
    command = [program, "run", recipe(3), "--rig", rig, "--out", tmp_path / "its", "--confirmed", "down"]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    kind = {3: palpate.DeviceError, 4: palpate.TripError, 2: palpate.UsageError}[done.returncode]
    with pytest.raises(kind) as failed:
        list(palpate.run(recipe(3), rig, tmp_path / "ours", confirmed=["down"]))
    assert failed.value.code == done.returncode
    squeezed = " ".join(done.stderr.replace("│", " ").split())
    assert str(failed.value).splitlines()[0].split(":")[0] in squeezed


def test_simulate_returns_the_run(tmp_path):
    run = palpate.simulate(EXAMPLE / "short.toml", seed=2, out=tmp_path / "run")
    assert run.path == tmp_path / "run" and run.manifest["simulated"] and run.manifest["status"] == "complete"
    shipped = palpate.simulate(out=tmp_path / "shipped")
    assert shipped.manifest["recipe"] == "calibrate" and palpate.fit(shipped, "pearson").outputs == 9


def test_a_stopped_run_is_resumed(recipe, tmp_path):
    with palpate.run(recipe(30), out=tmp_path / "run") as events:
        next(event for event in events if "event" not in event)
        events.stop()
        before = 1 + sum("event" not in event for event in events)
    with palpate.resume(tmp_path / "run") as events:
        presses = [event["press"] for event in events if "event" not in event]
    assert presses == list(range(before, 30))
    assert [event["status"] for event in palpate.resume(tmp_path / "run")] == ["complete"]
    with pytest.raises(palpate.UsageError, match="no-such"):
        palpate.resume(tmp_path / "no-such")
