"""The command that the wheel brings is the program: exit codes, signals, journal and output are those of the program.

Each scenario is played with both, at the same time.
"""

import csv
import json
import os
import signal
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import ROOT

# two presses of five levels; at this pace each takes a second or more, so a signal arrives in the middle of it
RECIPE = """rig = "sim"
name = "two"
[[step]]
phase = "characterisation"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 1.0 }
"""
RUN = ["run", "r.toml", "--out", "run", "--json"]
PACED = [*RUN, "--pace", "15"]
LEVELS = 5


@pytest.fixture
def play(program, tmp_path):
    """Plays a scenario with program and command, each in a folder of its own. Both must end the same. Returns how."""
    command = Path(sysconfig.get_path("scripts")) / "palpate"
    assert command.is_file(), "the wheel brings no command"

    def both(scenario):
        folders = [tmp_path / "program", tmp_path / "command"]
        for folder in folders:
            folder.mkdir()
            (folder / "r.toml").write_text(RECIPE)
        with ThreadPoolExecutor() as pool:
            of_program, of_command = pool.map(scenario, [program, command], folders)
        assert of_command == of_program
        return of_command

    return both


def ends(path, folder, words, **streams):
    given = {"stdin": subprocess.DEVNULL, "capture_output": True} | streams
    return subprocess.run([path, *words], cwd=folder, text=True, **given)


def pressing(words, folder):
    """Starts a program as a terminal does, at the head of a group. Returns it in its first press."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(words, cwd=folder, text=True, start_new_session=True, **pipes)
    wait_for(process, ": from press 1 of 2")
    return process


def wait_for(process, words):
    assert any(words in line for line in process.stderr), f"it ended before {words!r}"


def press_ctrl_c(process):
    os.killpg(process.pid, signal.SIGINT)


def left(path, folder, process):
    """What is left of an interrupted run: exit code, acknowledged rows, end and contacts of its journal; then, resumed, its rows."""
    rows, _ = process.communicate(timeout=60)
    lines = (folder / "run" / "journal.log").read_text().splitlines()
    records = [json.loads(line.split(" ", 2)[2]) for line in lines]
    end = [record["end"]["status"] for record in records if "end" in record]
    contacts = [record["contact"] for record in records if "contact" in record]
    resumed = ends(path, folder, ["resume", "run"])
    assert resumed.returncode == 0, resumed.stderr
    return process.returncode, rows, end, contacts, table(folder)


def table(folder):
    """The rows of a run, without their times."""
    with open(folder / "run" / "presses.csv", newline="") as presses:
        return [row | {"t_s": None} for row in csv.DictReader(presses)]


def test_texts_are_the_programs(play):
    def scenario(path, folder):
        texts = [["--help"], ["--version"], ["list"], ["check", "paper"], ["schema", "rig"]]
        return [ends(path, folder, words).stdout.replace("-dirty", "") for words in texts]

    assert all(play(scenario))


def test_exit_codes_are_the_programs(play):
    def scenario(path, folder):
        codes = [ends(path, folder, words).returncode for words in (RUN, ["check", "none.toml"])]
        (folder / "run" / "scene.csv").write_text("changed")
        rig = ["run", "r.toml", "--rig", ROOT / "rigs" / "esp301.toml", "--confirmed", "down"]
        codes += [ends(path, folder, words).returncode for words in (["verify", "run"], rig)]
        with open("/dev/full", "w") as full:
            streams = {"stdout": full, "stderr": subprocess.PIPE, "capture_output": False}
            codes += [ends(path, folder, words, **streams).returncode for words in (["list"], [*RUN[:3], "full", "--json"])]
        codes += [ends(path, folder, ["verify", "full"]).returncode]
        return codes, table(folder)

    codes, rows = play(scenario)
    assert codes == [0, 2, 1, 3, 5, 5, 0] and len(rows) == 2 * LEVELS


def test_ctrl_c_once_finishes_the_press(play):
    def scenario(path, folder):
        process = pressing([path, *PACED], folder)
        press_ctrl_c(process)
        return left(path, folder, process)

    code, rows, end, contacts, _ = play(scenario)
    assert (code, len(rows.splitlines()), end, len(contacts)) == (130, LEVELS, ["stopped"], 1)


def test_ctrl_c_twice_stops_at_once(play):
    def scenario(path, folder):
        process = pressing([path, *PACED], folder)
        press_ctrl_c(process)
        wait_for(process, "finishing this press")
        press_ctrl_c(process)
        return left(path, folder, process)

    assert play(scenario)[:4] == (130, "", ["stopped"], [])


def test_a_run_survives_its_parent(play):
    def scenario(path, folder):
        parent = pressing(["sh", "-c", '"$@"; true', "sh", path, *PACED], folder)
        parent.kill()
        return left(path, folder, parent)  # the streams end when the run has ended

    code, rows, end, contacts, _ = play(scenario)
    assert (code, len(rows.splitlines()), end, len(contacts)) == (-signal.SIGKILL, 2 * LEVELS, ["complete"], 2)


def test_a_kill_ends_all_of_it(play):
    def scenario(path, folder):
        process = pressing([path, *PACED], folder)
        process.kill()
        return left(path, folder, process)

    assert play(scenario)[:4] == (-signal.SIGKILL, "", [], [])


def test_a_library_is_loaded(play):
    """The stub of NI's library: its own words come back, so the command loads shared libraries."""

    def scenario(path, folder):
        stub = folder / "libnidaqmx.so"
        subprocess.run(["cc", "-shared", "-fPIC", "-o", stub, ROOT / "tests" / "outside" / "daqmx" / "stub.c"], check=True)
        words = [path, "emulate", "sim", "--json", "--port", "stage=0"]
        with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as emulators:
            listen = {device["device"]: device["listen"] for device in map(json.loads, (next(emulators.stdout) for _ in range(3)))}
            rig = (ROOT / "rigs" / "esp301.toml").read_text()
            for old, new in [
                ("serial:///dev/ttyUSB0?baud=921600", f"tcp://{listen['stage']}"),
                ('{ modbus = "generic-rs485" }', '{ daqmx = "Dev7/ai0", newton_per_volt = 1.0 }'),
                ("serial:///dev/ttyUSB1?baud=115200", f"daqmx://{stub}"),
                ('{ modbus = "labjack-t7" }', '{ daqmx = "Dev1/ai1:9" }'),
                ("tcp://192.168.1.10:502", f"daqmx://{stub}"),
            ]:
                assert old in rig
                rig = rig.replace(old, new)
            (folder / "rig.toml").write_text(rig)
            # locks of its own: both have the same device
            met = ends(path, folder, ["doctor", "rig.toml"], env={**os.environ, "TMPDIR": str(folder)})
            emulators.kill()
        return met.returncode, " ".join(met.stderr.replace("│", " ").split()).partition("it reports: ")[2]

    code, reported = play(scenario)
    assert code == 3 and reported.startswith("error -200220: Device identifier is invalid.")
