# SPDX-License-Identifier: Apache-2.0
"""The command as people call it: its words on the line, its status and what it says."""

import contextlib
import csv
import dataclasses
import importlib.metadata
import io
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from rich.console import Console

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_surface import cli
from mwd_surface.commands import terminal
from mwd_surface.commands.survey_table import show_surveys
from mwd_surface.surveys.survey_record import SurveyRecord
from project import REFERENCE_DATA

VOLVE = REFERENCE_DATA / "volve" / "volve_F5_raw_sixaxis.csv"


def mwd(*words):
    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["mwd", *map(str, words)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as ended:
            cli.main()
    finally:
        sys.argv = before
    return SimpleNamespace(returncode=ended.value.code or 0, stdout=out.getvalue(), stderr=err.getvalue())


def refused(done, *parts):
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1
    assert all(part in done.stderr for part in parts), done.stderr


def test_help_names_every_command():
    words = [sys.executable, "-m", "mwd_surface.cli", "--help"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0
    for command in (
        "run",
        "simulate",
        "process",
        "replay",
        "survey",
        "path",
        "node",
        "bag",
        "recover",
        "scenario",
        "plot",
        "calibrate",
        "doctor",
        "version",
    ):
        assert f" {command} " in done.stdout


@pytest.mark.parametrize("command", ["run", "simulate", "process", "replay", "survey", "node", "recover", "doctor"])
def test_every_command_has_an_example(command):
    done = mwd(command, "--help")
    assert done.returncode == 0
    assert f"mwd {command}" in done.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("forecast", "plan.csv", "-o", "out", "--axial", "nan"),
        ("forecast", "plan.csv", "-o", "out", "--lat", "nan", "--lon", "1"),
        ("spacing", "--inclination", "60", "--azimuth", "inf", "--field", "50360,71.6,1"),
        ("process", "run", "-o", "out", "--start", "nan"),
        ("replay", "run", "--rate", "nan"),
    ],
)
def test_no_command_takes_nan_or_infinity_for_a_number(words):
    """`mwd forecast --axial nan` printed that no station would be accepted."""
    done = mwd(*words)
    assert done.returncode == 2
    assert "is not a valid float" in done.stderr


def test_no_list_of_numbers_has_nan_or_infinity():
    refused(mwd("spacing", "--inclination", "60", "--azimuth", "85", "--field", "50360,nan,1"), "expected nT,dip")


def test_the_version_is_printed_by_command_and_by_option():
    asked, option = mwd("version"), mwd("--version")
    assert option.returncode == 0
    assert option.stdout == asked.stdout
    assert asked.stdout.startswith("mwd ")


@pytest.mark.fault_case(97)
def test_help_needs_no_heavy_package():
    code = (
        "import sys, mwd_surface.cli\n"
        "heavy = {'numpy', 'numba', 'rclpy', 'scipy', 'rosbags', 'aiohttp', 'yaml', 'rich', 'pygments'}\n"
        "sys.argv = ['mwd', '--help']\n"
        "try:\n    mwd_surface.cli.main()\n"
        "finally:\n    print(sorted(heavy & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.fault_case(37)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--declination", "-2.2"], "grid north: -1.25 deg is added to magnetic azimuths (declination -2.20 deg, conv"),
        (["--declination", "2.2"], "grid north: +3.15 deg is added to magnetic azimuths (declination +2.20 deg, conv"),
        (["--convergence", "0"], "true north: "),
    ],
)
def test_the_whole_correction_of_a_table_is_printed_with_its_parts(words, said):
    done = mwd("survey", VOLVE, *words, *(["--convergence", "-0.95"] if words[0] == "--declination" else []))
    assert done.returncode == 0, done.stderr
    assert said in done.stdout


NEEDED = [re.split("[<>=]", name)[0] for name in importlib.metadata.requires("mwd_surface") if "extra" not in name]
NEEDED += [name for name in importlib.metadata.requires("mwd_sensors") if "extra" not in name]
IMPORTED_AS = {"PyYAML": "yaml", "fpdf2": "fpdf", "pyserial": "serial"}
# A command without one package, if its name is given; says last which packages it has imported.
WITHOUT_PACKAGE = """
import sys
hidden, *sys.argv[1:] = sys.argv[1:]
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hidden())
from mwd_surface.__main__ import main
sys.argv[0] = "mwd"
try:
    main()
finally:
    print(*{name.partition(".")[0] for name in sys.modules})
"""


def without(package, folder):
    (folder / "list.csv").write_text("md_m,inc_deg,azi_deg\n0,0,0\n500,10,40\n")
    words = ["path", folder / "list.csv", "-o", folder / "out", "--field", "50360,71.63,-2.2"]
    return subprocess.run(
        [sys.executable, "-P", "-c", WITHOUT_PACKAGE, package, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Packages that the command imports if all are installed."""
    done = without("", tmp_path_factory.mktemp("complete"))
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1].split()


# In the gate: a package with another import name, one of the project, one that is imported first, one that prints and
# one that is imported late.
HIDDEN_IN_GATE = {"PyYAML", "mwd_estimation", "numpy", "rich", "welleng"}


@pytest.mark.slow(1)
@pytest.mark.fault_case(97, 98)
@pytest.mark.parametrize(
    "package",
    [
        pytest.param(name, marks=() if name in HIDDEN_IN_GATE else pytest.mark.nightly)
        for name in sorted({name.strip() for name in NEEDED})
    ],
)
def test_a_package_that_is_not_installed_is_named_with_the_command_that_installs_it(package, imported, tmp_path):
    """Each package that the project needs is hidden; a command either does not import it, or names it."""
    module = IMPORTED_AS.get(package, package)
    if module not in imported:
        return
    done = without(module, tmp_path)
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 2)
    if done.returncode == 2:
        # The project's own packages are installed together, from its folder.
        assert re.search(rf"pip install (\./\S+ )*(\./)?{package}\b", done.stderr)


def test_a_visit_to_a_graph_needs_no_simulator_and_no_compiler():
    pytest.importorskip("rclpy", reason="ROS is not installed for this Python")
    code = (
        "import sys, mwd_surface.commands.graph, mwd_surface.runs.launch_plan, mwd_surface.ros.graph_client\n"
        "print([m for m in ('numba', 'scipy', 'mwd_sensors.simulator.scenario') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_surveys_of_a_real_well_are_reproduced_and_judged(tmp_path):
    """Volve 15/9-F-5 (Equinor, open data): published angles and totals; two stations beside casing, one sound."""
    done = mwd("survey", VOLVE, "-o", tmp_path / "out.csv")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["verdict"] for line in lines] == ["reject", "reject", "accept"]
    assert all(line["reasons"] for line in lines)
    third = lines[2]
    assert float(third["inclination_deg"]) == pytest.approx(27.26, abs=0.005)
    assert float(third["azimuth_raw_deg"]) == pytest.approx(116.29, abs=0.005)
    assert float(third["azimuth_deg"]) == pytest.approx(116.29, abs=float(third["sigma_azimuth_deg"]))
    assert third["azimuth_reference"] == "grid"
    assert float(third["b_total_nt"]) == pytest.approx(50167.6, abs=0.06)
    assert float(third["dip_deg"]) == pytest.approx(71.41, abs=0.005)


@pytest.mark.slow
def test_a_table_is_a_run_whose_rows_keep_their_first_value_and_single_judges_each_alone(tmp_path):
    def lines(*words):
        done = mwd("survey", VOLVE, "-o", tmp_path / "out.csv", *words)
        assert done.returncode == 0, done.stderr
        with (tmp_path / "out.csv").open() as file:
            return done.stdout, list(csv.DictReader(file))

    shown, together = lines()
    assert "analysed together: the table: 3" in shown
    assert [line["verdict"] for line in together] == ["reject", "reject", "accept"]
    assert together[2]["outlier"] == "no"
    assert all(line["first_verdict"] and line["first_azimuth_deg"] for line in together)
    shown, alone = lines("--single")
    assert "together" not in shown
    assert {line["revised_because"] for line in alone} == {""}
    # The first row of a run has nothing before it.
    assert together[0]["first_azimuth_deg"] == alone[0]["azimuth_deg"]
    # Of three runs of one row each nothing is revised.
    _, apart = lines("--runs", "md_m")
    assert [line["azimuth_deg"] for line in apart] == [line["azimuth_deg"] for line in alone]
    assert {line["revised_because"] for line in apart} == {""}
    refused(mwd("survey", VOLVE, "--runs", "bha"), "there is no column 'bha'")


STATION = "md_m,grav_axial_mps2,grav_tran1_mps2,grav_tran2_mps2,mag_axial_nT,mag_tran1_nT,mag_tran2_nT\n"
STATION += "1386.4,8.7425784,-2.5743408,3.697224,38880,-27840,15168\n"


@pytest.mark.slow
def test_the_options_are_the_reference_where_the_table_has_none(tmp_path):
    table, out = tmp_path / "table.csv", tmp_path / "out.csv"
    table.write_text(STATION)
    for options, north, azimuth in (
        ((), "magnetic", 117.55),
        (("--field", "50360.5,71.63,-2.21"), "true", 115.34),
        (("--field", "50360.5,71.63", "--declination", -2.21, "--convergence", -0.95), "grid", 116.29),
    ):
        assert mwd("survey", table, "-o", out, *options).returncode == 0
        with out.open() as file:
            (line,) = csv.DictReader(file)
        assert line["azimuth_reference"] == north
        assert float(line["azimuth_raw_deg"]) == pytest.approx(azimuth, abs=0.01)
        assert float(line["azimuth_deg"]) == pytest.approx(azimuth, abs=float(line["sigma_azimuth_deg"]))
        assert line["verdict"] == ("doubtful" if north == "magnetic" else "accept")


def test_the_widest_figures_of_a_station_fit_a_plain_terminal(monkeypatch):
    screen = io.StringIO()
    monkeypatch.setattr(terminal, "output", lambda: Console(file=screen, width=80))
    survey = Survey(
        0,
        "",
        1,
        inclination=2.0,
        azimuth=6.28,
        north=int(North.MAGNETIC),
        covariance=(0.005**2, 0.0, 0.0, 0.0, 0.2**2, 0.0, 0.0, 0.0, 0.01),
        gravity_toolface=6.0,
        b_total=51234.4e-9,
        dip=-1.2,
        verdict=int(Verdict.DOUBTFUL),
        headline="the field has no horizontal part",
    )
    numbered = [dataclasses.replace(survey, sequence=k) for k in range(1, 121)]
    show_surveys([SurveyRecord(one, 12345.6) for one in numbered])
    row = screen.getvalue().splitlines()[2]
    assert " ".join(row.split()) == "109 12345.6 114.59 ±0.29 359.8 ±11.5 magnetic 343.8 51234 -68.75 doubtful"
    # One line says what to do about all stations with the same reason.
    assert screen.getvalue().count("doubtful: ") == 1
    assert "1-120 doubtful: " in screen.getvalue()


@pytest.mark.slow
def test_a_table_that_cannot_be_used_is_refused_in_one_sentence(tmp_path):
    table = tmp_path / "table.csv"
    refused(mwd("survey", table, "-o", tmp_path / "out.csv"), "table.csv", "No such file")
    table.write_text("md_m,gx\n1,2\n")
    refused(mwd("survey", table, "-o", tmp_path / "out.csv"), "gravity: no column")
    table.write_text(STATION)
    refused(mwd("survey", table, "--field", "50360"), "--field 50360", "nT,dip,declination")
    refused(mwd("survey", table, "--lat", "58"), "--lat and --lon")
    refused(mwd("survey", table, "--set", "survey.nort=true"), "did you mean survey.north")
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.slow
def test_a_bag_that_cannot_be_used_is_refused_in_one_sentence(tmp_path):
    refused(mwd("process", tmp_path / "bag", "-o", tmp_path / "out"), "there is nothing at")
    (tmp_path / "bag").mkdir()
    refused(mwd("process", tmp_path / "bag", "-o", tmp_path / "out"), "holds no recording")
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"")
    refused(mwd("process", tmp_path / "bag", "-o", tmp_path / "out"), "is empty")
    refused(mwd("bag", "info", tmp_path / "bag"), "is empty")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag"]


@pytest.mark.slow
def test_every_option_of_the_reference_of_a_table_counts_or_is_refused(tmp_path):
    def reference(*words):
        done = mwd("survey", VOLVE, "-o", tmp_path / "out.csv", *words)
        assert done.returncode == 0, done.stderr
        with (tmp_path / "out.csv").open() as file:
            return list(csv.DictReader(file))[2]

    place = ("--lat", 58.44, "--lon", 1.88)
    plain = reference(*place, "--convergence", 0)
    assert plain["azimuth_reference"] == "true"  # the day is that of the first row, a convergence of 0 is no grid
    for change in ("place.height_m=-3000", "place.date=1990-01-01"):
        assert reference(*place, "--set", change)["b_reference_nt"] != plain["b_reference_nt"]
    utm = reference(*place, "--set", "place.grid=utm")
    assert (utm["azimuth_reference"], utm["convergence_deg"][:4]) == ("grid", "-0.9")
    # Rows know the declination that the field is given without.
    assert reference("--field", "50000,71")["azimuth_reference"] == "grid"
    assert reference("--field", "50000,71")["b_reference_nt"] == "50000.0"
    for words, says in (
        (("--set", "place.height_m=100"), "place.height_m: needs a place"),
        (("--field", "50000,71", "--set", "place.grid=utm"), "place.grid: is not used"),
        ((*place, "--set", "place.dip_deg=71"), "place.dip_deg: is not used for a table with a model"),
        ((*place, "--set", "reference.grid=utm"), "place"),
    ):
        refused(mwd("survey", VOLVE, *words), says)


@pytest.mark.slow
def test_a_gyro_list_becomes_a_path_and_every_export_of_it_gives_the_same_path(tmp_path):
    gyro = REFERENCE_DATA / "volve" / "F-4_gyro_ns_trajectory.csv"
    place = ("--lat", 58.44, "--lon", 1.88, "--date", "2026-03-01")
    done = mwd("path", gyro, "-o", tmp_path / "gyro", *place)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "gyro" / "path.csv").read_text()
    assert text.startswith("md_m,inclination_deg,azimuth_deg,tvd_m,north_m,east_m,vertical_section_m,dls_deg_per_30m,")
    first = list(csv.DictReader(io.StringIO(text)))
    assert float(first[-1]["sigma_east_m"]) > 5.0
    for name in ("f4.csv", "f4.las", "f4.xml"):
        assert mwd("export", tmp_path / "gyro", "-o", tmp_path / name).returncode == 0
        done = mwd("path", tmp_path / name, "-o", tmp_path / "again", *place, "--code", "GYRO-NS")
        assert done.returncode == 0, done.stderr
        again = list(csv.DictReader(io.StringIO((tmp_path / "again" / "path.csv").read_text())))
        assert len(again) == len(first) == 87
        for key in ("md_m", "tvd_m", "north_m", "east_m", "sigma_north_m"):
            assert float(again[-1][key]) == pytest.approx(float(first[-1][key]), abs=1e-3)
    done = mwd(
        "path", gyro, "-o", tmp_path / "both", *place, "--against", tmp_path / "f4.las", "--against-code", "MWD+SRGM"
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "both" / "comparison.csv").open() as file:
        assert all(float(line["distance_m"]) < 1e-3 for line in csv.DictReader(file))
    assert (tmp_path / "both" / "comparison.png").is_file()


@pytest.mark.slow
def test_a_list_that_cannot_be_used_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "list.csv").write_text("Depth,Inc,Azi true\n0,0,0\n100,1,2\n")
    refused(mwd("path", tmp_path / "list.csv", "-o", tmp_path / "out"), "has no unit", "--length-unit")
    wrong = ("--set", "place.height_m=100")
    refused(mwd("path", tmp_path / "list.csv", "-o", tmp_path / "out", *wrong, "--length-unit", "m"), "needs a place")
    refused(mwd("path", tmp_path / "list.csv", "-o", tmp_path / "out", "--length-unit", "m", "--code", "MWD"), "MWD+")
    refused(
        mwd("path", tmp_path / "list.csv", "-o", tmp_path / "out", "--length-unit", "m", "--tie-on", "100"),
        "--tie-on 100",
    )
    assert not (tmp_path / "out" / "path.csv").exists()


@pytest.mark.slow
def test_a_simulated_run_is_processed_to_its_surveys(tmp_path):
    scenario = tmp_path / "still.yaml"
    scenario.write_text(
        "name: still\nwell: {stations: [[0.0, 40.0, 70.0]], bit_m: 103.0}\nschedule: [{kind: still, seconds: 14.0}]\n"
    )
    assert mwd("simulate", scenario, "-o", tmp_path / "bag", "--namespace", "/well_4").returncode == 0
    done = mwd("process", tmp_path / "bag", "-o", tmp_path / "out", "--set", "gravity.method=s3")
    assert done.returncode == 0, done.stderr
    assert "/well_4/imu/data_raw: 1600 samples" in done.stdout
    with (tmp_path / "out" / "surveys.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert float(line["inclination_deg"]) == pytest.approx(40.0, abs=0.2)
    assert float(line["azimuth_deg"]) == pytest.approx(70.0, abs=1.5)
    # Place and the distance to the bit, 3 m, come from the recording.
    assert line["azimuth_reference"] == "true"
    assert float(line["md_m"]) == pytest.approx(100.0, abs=0.01)
    done = mwd("bag", "info", tmp_path / "bag")
    assert done.returncode == 0
    assert "/well_4/truth" in done.stdout
    # The folder of a run has the same recording, with the same size.
    run = tmp_path / "run" / "well_4" / "bags"
    run.mkdir(parents=True)
    (tmp_path / "bag").rename(run / "bag")
    of_run = mwd("bag", "info", tmp_path / "run")
    assert of_run.stdout.split(": ", 1)[1] == done.stdout.split(": ", 1)[1]
    size = sum(file.stat().st_size for file in (run / "bag").glob("*.mcap"))
    assert f", {size / 1e6:.1f} MB" in of_run.stdout


@pytest.mark.slow
def test_a_warning_that_several_surveys_share_is_given_once_with_their_numbers(tmp_path):
    scenario, depths = tmp_path / "four.yaml", tmp_path / "depths.csv"
    scenario.write_text(
        "name: four\nwell: {stations: [[0.0, 40.0, 70.0]], bit_m: 103.0}\ncycles: 4\n"
        "schedule: [{kind: still, seconds: 14.0}, {kind: move, seconds: 6.0, rop_m_h: 3600.0}]\n"
    )
    depths.write_text("survey,md_m\n1,1000\n2,1100\n3,1200\n4,1300\n")
    assert mwd("simulate", scenario, "-o", tmp_path / "bag").returncode == 0
    place = ("--lat", 38, "--lon", 109, "--depths", depths)
    done = mwd("process", tmp_path / "bag", "-o", tmp_path / "out", *place)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("gap 100 m is over 60 m") == 1
    assert "survey 2-4: gap 100 m is over 60 m" in done.stderr


@pytest.mark.slow
def test_an_older_recording_takes_the_older_field_model(tmp_path):
    scenario = tmp_path / "old.yaml"
    scenario.write_text("name: old\ndate: 2012-05-01\nmodel: igrf\nschedule: [{kind: still, seconds: 2.0}]\n")
    assert mwd("simulate", scenario, "-o", tmp_path / "bag").returncode == 0
    done = mwd("process", tmp_path / "bag", "-o", tmp_path / "out", "--set", "place.field=model")
    assert done.returncode == 0
    assert "IGRF" in done.stdout
    assert "outside wmm2025" in done.stderr


@pytest.mark.slow
def test_a_damaged_recording_is_recovered(tmp_path):
    scenario = tmp_path / "short.yaml"
    scenario.write_text("name: short\nschedule: [{kind: still, seconds: 5.0}]\n")
    assert mwd("simulate", scenario, "-o", tmp_path / "bag").returncode == 0
    file = next((tmp_path / "bag").glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-100])
    refused(mwd("process", tmp_path / "bag", "-o", tmp_path / "out"), "cut off or damaged", "mwd recover")
    assert mwd("recover", tmp_path / "bag").returncode == 0
    assert mwd("process", tmp_path / "bag", "-o", tmp_path / "out").returncode == 0


@pytest.mark.fault_case(62)
def test_a_full_disk_is_named_with_its_remedy():
    done = mwd("security", "w1", "-o", "/dev/full")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "mwd: No space left on device: free some space on this disk, or write to another disk\n"


def test_an_unknown_node_is_refused():
    done = mwd("node", "engine")
    assert done.returncode == 2
    assert "sonde" in done.stderr


def test_results_of_a_run_are_replaced_only_with_force(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "attitude.parquet").write_bytes(b"of another run")
    refused(mwd("process", tmp_path / "bag", "-o", out), "attitude.parquet", "--force")
    assert (out / "attitude.parquet").read_bytes() == b"of another run"
