# SPDX-License-Identifier: Apache-2.0
"""One list in the words of many countries and programs: its north, units, projections and marks are read or refused."""

import datetime as dt
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import utc
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.list_files.table import text_of

MD = np.arange(0.0, 601.0, 30.0)
INC = np.clip((MD - 90.0) * 0.1, 0.0, 45.0)
AZI = np.full_like(MD, 118.25)
PLACES = mc.path(MD, np.radians(INC), np.radians(AZI), (0.0, 0.0, 0.0))
LANGUAGES = {
    "german": "Meßteufe [m];Neigung [Grad];Azimut [Grad];Teufe senkrecht [m]",
    "german long": "Bohrlochlänge (m);Neigungswinkel (°);Richtung (°);Vertikale Teufe (m)",
    "french": "Profondeur mesurée (m);Inclinaison (degrés);Azimut (degrés);Profondeur verticale (m)",
    "norwegian": "Målt dybde (m);Inklinasjon (grader);Asimut (grader);Vertikal dybde (m)",
    "portuguese": "Profundidade Medida (metros);Inclinação (graus);Azimute (graus);Profundidade vertical (metros)",
    "italian": "Profondità misurata (m);Inclinazione (gradi);Azimut (gradi);Profondità verticale (m)",
    "dutch": "Gemeten diepte (m);Inclinatie (graden);Azimut (graden);Verticale diepte (m)",
    "spanish": "Profundidad medida (m);Inclinación (grados);Azimut (grados);Profundidad vertical (m)",
    "russian": "Глубина по стволу, м;Зенитный угол, град;Азимут, град;Глубина по вертикали, м",
    "chinese": "测深(米);井斜角(度);方位角(度);垂深(米)",
}


def rows(separator=";", decimal=",", inc=INC, azi=AZI):
    lines = (f"{m:.2f}{separator}{i:.2f}{separator}{a:.2f}" for m, i, a in zip(MD, inc, azi, strict=True))
    return "".join(f"{line.replace('.', decimal)}\n" for line in lines)


def read(text, encoding="utf-8"):
    return list_of(text.encode(encoding), "list.csv")


def assert_read(stations):
    np.testing.assert_allclose(stations.md, MD)
    np.testing.assert_allclose(np.degrees(stations.inclination), INC, atol=0.006)
    np.testing.assert_allclose(np.degrees(stations.azimuth), AZI, atol=0.006)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_columns_of_a_list_are_read_in_many_languages_and_its_vertical_depths_checked(language):
    first = LANGUAGES[language].rsplit(";", 1)[0]
    assert_read(read(f"{first}\n{rows()}"))
    wrong = "".join(f"{line};{10.0 * k:.2f}\n" for k, line in enumerate(rows().splitlines()))
    with pytest.raises(ListFileError, match="does not fit the angles"):
        read(f"{LANGUAGES[language]}\n{wrong}")


@pytest.mark.parametrize("encoding", ["cp1251", "cp866", "koi8-r", "utf-8", "utf-16"])
def test_russian_lists_are_read_in_every_usual_encoding(encoding):
    text = f"{LANGUAGES['russian'].rsplit(';', 1)[0]}\n{rows()}"
    assert text_of(text.encode(encoding), "list.csv").lstrip("\ufeff") == text
    assert_read(read(text, encoding))


@pytest.mark.parametrize(
    ("line", "north"),
    [
        ("All azimuths are corrected to Grid North", "grid"),
        ("AZIMUTHS CORRECTED TO TRUE NORTH", "true"),
        ("Survey referenced to True North", "true"),
        ("Declination applied: 1.2 deg (Azimuths are Grid)", "grid"),
        ("Az. reference - Grid", "grid"),
        ("Azimuth: Magnetic", "magnetic"),
        ("Grid azimuths", "grid"),
        ("Nordreferenz: Gitter", "grid"),
        ("Nordrichtung: geografisch", "true"),
        ("Nordreferanse: Rutenett", "grid"),
        ("Référence nord : Nord géographique", "true"),
        ("Norte de referencia: Cuadrícula", "grid"),
        ("Направление севера: истинный", "true"),
        ("北参考: 真北", "true"),
        ("方位角类型: 网格方位", "grid"),
        # The north behind "to" is the north of a sentence.
        ("Azimuths corrected from magnetic to true north", "true"),
        ("All azimuths in this report are referenced to Grid North (UTM 31N); declination -1.2 deg.", "grid"),
        ("azimuths to True North unless stated otherwise", "true"),
    ],
)
@pytest.mark.parametrize("mark", ["", "# "])
def test_a_sentence_about_azimuths_gives_their_north(line, north, mark):
    assert read(f"{mark}{line}\nMD (m);Inc (°);Azi (°)\n{rows()}").north == north


@pytest.mark.parametrize(
    "line",
    [
        "Well: True North 7",
        "Map Zone: Texas North Central 4202",
        "Magnetic declination: -1.2",
        "Total Correction: 1.2 (Mag to Grid)",
        "Vertical Section Azimuth: 120 (Grid North)",
        "North Sea Magnetic Anomaly",
    ],
)
def test_a_line_about_something_else_gives_no_north(line):
    assert read(f"{line}\nMD (m);Inc (°);Azi (°)\n{rows()}").north == ""


def test_two_sentences_that_differ_are_quoted():
    text = "Azimuth sensor is a magnetic tool\nAzimuths below are corrected to grid\nMD (m);Inc (°);Azi (°)\n"
    with pytest.raises(ListFileError, match=r"magnetic tool.*corrected to grid"):
        read(text + rows())


@pytest.mark.parametrize(("name", "north"), [("Azimuth (°M)", "magnetic"), ("Azi deg T", "true"), ("Azi [°G]", "grid")])
def test_the_letter_behind_a_degree_sign_is_a_north(name, north):
    assert read(f"MD (m);Inc (°);{name}\n{rows()}").north == north


@given(st.sampled_from(["true", "grid", "magnetic"]), st.sampled_from(["2.0", "3.0"]))
def test_the_description_of_a_las_curve_gives_the_north(north, version):
    words = f"Azimuth from {north} north"
    curves = f"MD.M : Depth\nDEVI.DEG : Deviation\nAZIM.DEG : {words}\n"
    head = f"~Version\nVERS. {version} :\nWRAP. NO :\n{{}}~Well\nNULL. -999.25 :\n"
    if version == "3.0":
        text = head.format("DLM. COMMA :\n") + f"~Inclinometry_Definition\n{curves}"
        text += f"~Inclinometry_Data | Inclinometry_Definition\n{rows(',', '.')}"
    else:
        text = head.format("") + f"~Curve\n{curves}~A\n{rows(' ', '.')}"
    assert read(text).north == north


def test_the_letter_f_of_las_is_a_foot():
    head = "~Version\nVERS. 2.0 :\nWRAP. NO :\n~Well\nNULL. -999.25 :\n~Curve\nDEPT.F :\nDEVI.DEG :\nAZIM.DEG :\n~A\n"
    text = head + rows(" ", ".")
    np.testing.assert_allclose(read(text).md, 0.3048 * MD)


@pytest.mark.parametrize("word", ["Projection to bit", "PROJECTED", "Projected to TD", "extrapolated to TD"])
@pytest.mark.parametrize("beside", [True, False])
def test_a_projection_below_a_list_is_no_station(word, beside):
    last = f"630;46,00;118,25;{word}\n" if beside else f"{word}\n630;46,00;118,25\n"
    got = read(f"MD (m);Inc (°);Azi (°);Remark\n{rows()}{last}")
    assert_read(got)
    assert any(one.kind == RemarkKind.ROWS_LEFT_OUT and "630" in one.text for one in got.remarks)


@given(st.integers(1, 18))
def test_a_comment_about_a_projection_between_stations_leaves_none_out(k):
    lines = rows().splitlines()
    lines[k] += ";was projected to bit before"
    assert_read(read("MD (m);Inc (°);Azi (°);Remark\n" + "\n".join(lines)))


@given(st.sampled_from([0, 1, 2]))
def test_decimal_commas_that_part_columns_are_refused(digits):
    lines = (f"{m:.2f},{i:.{digits}f},{a:.2f}".replace(".", ",") for m, i, a in zip(MD, INC, AZI, strict=True))
    with pytest.raises(ListFileError, match="cells under 3 names"):
        read("MD (m),Inc (°),Azi (°)\n" + "\n".join(lines))


def test_names_in_several_lines_of_a_quoted_cell_are_read():
    names = '"Measured\nDepth\n(m)","Inc\n(deg)","Azimuth\nfrom grid\n(deg)"'
    assert_read(read(f"{names}\n{rows(',', '.')}"))


def test_grads_are_gon_where_no_name_is_german():
    got = read(f"MD (m);Inc (grad);Azi (grad)\n{rows(inc=INC / 0.9, azi=AZI / 0.9)}")
    assert math.degrees(got.inclination[-1]) == pytest.approx(INC[-1], abs=0.01)


@given(st.floats(0.0, 359.99), st.sampled_from(["decimal", "minutes"]), st.booleans())
def test_bearings_by_quadrant_and_sexagesimal_angles_are_the_same_azimuths(azimuth, form, spaced):
    pole = "N" if azimuth <= 90.0 or azimuth >= 270.0 else "S"
    side = "E" if azimuth < 180.0 else "W"
    within = min(azimuth % 180.0, 180.0 - azimuth % 180.0)
    seconds = round(within * 3600.0)
    sexagesimal = f"{seconds // 3600}°{seconds // 60 % 60:02d}'{seconds % 60:02d}\""
    text = f"{within:.4f}" if form == "decimal" else sexagesimal
    gap = " " if spaced else ""
    got = read(f"MD (m);Inc (°);Azi\n0;0;0\n30;2°30';{pole}{gap}{text}{gap}{side}\n")
    assert math.degrees(got.inclination[1]) == pytest.approx(2.5)
    apart = math.remainder(math.degrees(got.azimuth[1]) - azimuth, 360.0)
    assert abs(apart) < 3e-4


@pytest.mark.parametrize("mark", [".", ","])
def test_degrees_and_minutes_with_a_space_between_them_are_no_number_of_degrees(mark):
    text = "MD (m);Inc;Azi\n0;0 00.0;0 00.0\n30;0 30.5;2 30.0\n60;1 30.0;3 06 36.0\n".replace(".", mark)
    got = read(text)
    np.testing.assert_allclose(np.degrees(got.inclination), [0.0, 30.5 / 60.0, 1.5])
    np.testing.assert_allclose(np.degrees(got.azimuth)[1:], [2.5, 3.11])
    with pytest.raises(ListFileError, match="30 5"):
        read("MD (m);Inc;Azi\n0;0;0\n30 5;1;2\n60;1;2\n")
    assert read("MD (m);Inc;Azi\n0;0;0\n1 030;- 0;2\n2 060;0;2\n").md[-1] == 2060.0


@given(st.integers(1, 6), st.sampled_from(["before", "behind"]))
def test_a_blank_azimuth_in_a_table_of_spaces_moves_no_other_cell(blank, place):
    lines = []
    for k, (m, i, a) in enumerate(zip(MD, INC, AZI, strict=True)):
        azimuth = "" if k < blank and i == 0.0 else f"{a:.2f}"
        others = f"{0.25 * k:8.2f}"
        lines.append(f"{m:8.2f} {i:7.2f} {azimuth:>7} " + (others if place == "behind" else ""))
    names = "   MD(m) Inc(°)  Azi(°) " + ("   DLS" if place == "behind" else "")
    got = read("\n".join([names, *lines]))
    np.testing.assert_allclose(got.md, MD)
    np.testing.assert_allclose(np.degrees(got.azimuth[min(blank, 4) :]), AZI[min(blank, 4) :], atol=1e-6)
    assert np.all(np.isnan(got.azimuth[: min(blank, 4)]))


@pytest.mark.parametrize(("name", "north"), [("x", ""), ("col7", ""), ("HZ true", "true"), ("Q (grid)", "grid")])
def test_a_column_that_the_caller_names_need_not_be_understood_but_its_north_counts(name, north):
    told = Given(columns={"md": "q1 (m)", "inclination": "i", "azimuth": name})
    got = list_of(f"q1 (m);i;{name}\n{rows()}".encode(), "list.csv", told)
    assert_read(got)
    assert got.north == north


@pytest.mark.parametrize("depth", ["孔深(m)", "孔深/m", "钻孔深度（米）", "累计孔深(m)", "钻深(m)", "深度（m）"])
@pytest.mark.parametrize(
    ("azimuth", "north"),
    [
        ("方位角(°)", ""),
        ("实测方位角/°", ""),
        ("真方位", "true"),
        ("真方位角（°）", "true"),
        ("磁方位(度)", "magnetic"),
        ("磁方位角", "magnetic"),
        ("方位角（磁北）", "magnetic"),
        ("坐标方位角", "grid"),
    ],
)
def test_chinese_names_of_depth_and_azimuth_are_read_with_their_north(depth, azimuth, north):
    read = list_of(f"{depth},倾角(°),{azimuth}\n0,90,30\n30,87,31\n".encode(), given=Given(dip="down"))
    assert read.north == north
    np.testing.assert_allclose(read.md, [0.0, 30.0])
    np.testing.assert_allclose(np.degrees(read.inclination), [0.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(read.azimuth), [30.0, 31.0], atol=1e-9)


@pytest.mark.parametrize(
    "name", ["设计倾角", "磁倾角", "Magnetic Dip", "Tilt", "Slope", "Vertical angle", "开孔倾角", "孔斜角"]
)
def test_an_angle_that_may_be_another_is_never_taken_for_an_inclination(name):
    with pytest.raises(ListFileError, match="no column for inclination"):
        list_of(f"md_m,{name},azi\n0,20,30\n30,21,31\n".encode())


ROWS = "md_m,inc,azi\n0,0,0\n300,0,0\n330,3,79\n360,6,79\n"


@pytest.mark.parametrize(
    "line",
    [
        "Note: Azimuth readings are NOT corrected for declination.",
        "Azimuth Reference: not magnetic",
        "Azimuths have been corrected for declination and convergence",
        "Azimuths are given uncorrected, magnetic",
        "方位角未作磁偏角校正",
    ],
)
def test_a_sentence_about_azimuths_that_is_not_understood_is_a_question(line):
    with pytest.raises(ListFileError) as caught:
        list_of(f"{line}\n{ROWS}".encode())
    assert line.partition(": ")[2] in str(caught.value) or line in str(caught.value)
    assert "--north" in str(caught.value)
    assert list_of(f"{line}\n{ROWS}".encode(), given=Given(north="magnetic")).north == "magnetic"


@pytest.mark.parametrize(
    "footer",
    [
        "Bottom hole: 360 m,6 deg,79 deg",
        "Closure,12.3,45.6",
        "TD at 360 m",
        "Surveyed by: J. Doe",
        "Closure: 3.1 m,79,",
    ],
)
def test_figures_of_the_whole_hole_below_a_list_are_quoted_and_no_station(footer):
    read = list_of(f"{ROWS}\n{footer}\n".encode())
    assert read.md[-1] == 360.0
    assert any(footer.split(",")[0] in one.text for one in read.remarks if one.kind == RemarkKind.ROWS_LEFT_OUT)


def test_a_depth_that_is_a_typo_between_stations_is_refused():
    with pytest.raises(ListFileError, match="expected a finite number"):
        list_of(ROWS.replace("330,3", "l330,3").encode())


def test_a_line_of_datum_and_north_below_the_units_counts():
    read = list_of(b"md,inc,azi\nm,deg,deg\nRKB,,GN\n0,0,0\n300,0,0\n330,3,79\n")
    assert read.north == "grid"
    assert read.md.size == 3


def test_a_unit_or_north_that_the_caller_replaces_is_a_remark():
    data = b"md_m,inc_deg,azi_true_deg\n0,0,0\n300,0,0\n330,3,79\n"
    assert list_of(data, given=Given(length_unit="m", angle_unit="deg", north="true")).remarks == ()
    read = list_of(data, given=Given(length_unit="ft", north="grid"))
    assert read.md[-1] == pytest.approx(330 * 0.3048)
    assert [one.kind for one in read.remarks] == [RemarkKind.OVERRIDDEN] * 2


@pytest.mark.parametrize(
    ("names", "form"),
    [
        ("Date,Time", "{:%d/%m/%Y,%H:%M}"),
        ("Date", "{:%d.%m.%Y %H:%M}"),
        ("Survey Time", "{:%d-%b-%y %I:%M %p}"),
        ("DTIM", "{:%Y-%m-%dT%H:%M:00Z}"),
        ("Datum,DTIM", "RKB,{:%Y-%m-%dT%H:%M:00Z}"),
        ("Date,Time", "{0:%Y-%m-%d},{0:%Y-%m-%d %H:%M}"),
    ],
)
def test_dates_and_clocks_in_any_usual_form_are_the_times_of_the_stations(names, form):
    times = [dt.datetime(2026, 3, 1, 6, 30, tzinfo=dt.UTC) + dt.timedelta(hours=12 * k) for k in range(len(MD))]
    lines = [f"{line},{form.format(at)}" for line, at in zip(rows(",", ".").splitlines(), times, strict=True)]
    stations = read("\n".join([f"MD (m),Inc,Azi,{names}", *lines]))
    assert_read(stations)
    assert [utc.moment(text) for text in stations.time] == times


def with_column(name, word, *, extra):
    """A list with a column that accepts its stations, and, above the fifth one, with a row that it does not accept."""
    lines = [f"{line},{word}" for line in rows(",", ".").splitlines()]
    return "\n".join(["MD (m),Inc,Azi," + name, *lines[:5], extra, *lines[5:]]) + "\n"


@pytest.mark.parametrize(
    ("name", "accepted", "rejected"),
    [
        ("Status", "Accepted", "Rejected"),
        ("QC", "GOOD", "BAD"),
        ("Verdict", "ok", "fail"),
        ("Use", "Y", "N"),
        ("Used", "1", "0"),
        ("Accepted", "true", "false"),
        ("Accept/Reject", "Accept", "Reject"),
        ("QC Pass", "Yes", "No"),
    ],
)
@pytest.mark.parametrize("bad", ["119.00,3.00,291.00", "120.00,3.00,291.00"])
def test_a_station_that_its_list_rejects_is_left_out(name, accepted, rejected, bad):
    stations = read(with_column(name, accepted, extra=f"{bad},{rejected}"))
    assert_read(stations)
    assert [one.kind for one in stations.remarks] == [RemarkKind.ROWS_LEFT_OUT]


def test_a_suspect_station_is_doubtful():
    stations = read(
        with_column("QC", "Good", extra="120.00,3.00,120.00,Suspect").replace("120.00,3.00,118.25,Good\n", "")
    )
    assert [k for k, verdict in enumerate(stations.verdict) if verdict != "accept"] == [4]
    assert stations.verdict[4] == "doubtful"


def test_a_word_that_neither_accepts_nor_rejects_is_quoted():
    stations = read(with_column("Status", "A7", extra=""))
    assert_read(stations)
    assert any("'a7'" in one.text and "'Status'" in one.text for one in stations.remarks)
    marked = read(with_column("Bad", "", extra=""))
    assert [one.kind for one in marked.remarks] == [RemarkKind.COLUMN_NOT_READ]


def test_a_list_from_the_bottom_up_is_the_same_list():
    head, *lines = ["MD (m),Inc,Azi", *rows(",", ".").splitlines()]
    stations = read("\n".join([head, *lines[::-1]]))
    assert_read(stations)
    assert [one.kind for one in stations.remarks] == [RemarkKind.ROWS_REORDERED]


@pytest.mark.parametrize("deeper", [0.0, 900.0])
def test_a_list_of_several_holes_is_refused_by_name_and_one_of_one_hole_is_read(deeper):
    one = [f"DD01,{line}" for line in rows(",", ".").splitlines()]
    two = [f"DD02,{md + deeper:.2f},45.00,118.25" for md in MD]
    assert_read(read("\n".join(["HOLE_ID,MD (m),Inc,Azi", *one])))
    with pytest.raises(ListFileError, match=r"'HOLE_ID' names 2 holes \(DD01, DD02\)"):
        read("\n".join(["HOLE_ID,MD (m),Inc,Azi", *one, *two]))


def test_the_order_of_the_stations_of_a_trajectory_has_no_meaning_and_its_rejected_ones_are_left_out():
    stations = [
        f'<trajectoryStation><typeTrajStation>{kind}</typeTrajStation><md uom="m">{md}</md><incl uom="deg">{inc}</incl>'
        f'<azi uom="deg">{azi}</azi><statusTrajStation>{status}</statusTrajStation></trajectoryStation>'
        for md, inc, azi, kind, status in [
            *((md, inc, azi, "magnetic MWD", "position") for md, inc, azi in zip(MD, INC, AZI, strict=True)),
            (100.0, 2.0, 300.0, "magnetic MWD", "rejected"),
            (620.0, 45.0, 118.25, "extrapolated", "open"),
        ]
    ]
    order = np.random.default_rng(1).permutation(len(stations))
    text = "".join(stations[k] for k in order)
    assert_read(read(f'<trajectorys version="1.4.1.1"><trajectory>{text}</trajectory></trajectorys>'))


@pytest.mark.parametrize("name", ["Azi Type", "North Ref", "Azimuth Reference"])
def test_a_column_of_the_north_is_the_north(name):
    lines = [f"{line},Grid" for line in rows(",", ".").splitlines()]
    stations = read("\n".join([f"MD (m),Inc,Azi,{name}", *lines]))
    assert_read(stations)
    assert stations.north == "grid"


def test_the_depth_of_the_hole_is_not_the_depth_of_a_survey_unless_it_is_the_only_depth():
    lines = rows(",", ".").splitlines()
    deeper = [f"{md + 15.0:.2f},{line}" for md, line in zip(MD, lines, strict=True)]
    assert_read(read("\n".join(["Hole Depth (m),Survey Depth (m),Inc,Azi", *deeper])))
    assert_read(read("\n".join(["Hole Depth (m),Inc,Azi", *lines])))


def test_the_errors_of_the_angles_are_not_angles():
    lines = [f"{line},0.10,0.50" for line in rows(",", ".").splitlines()]
    assert_read(read("\n".join(["MD (m),Inc (deg),Azi (deg),Inc Err (deg),Azi Unc (deg)", *lines])))


def test_numbers_that_a_spreadsheet_shall_keep_as_text_are_numbers():
    lines = [",".join(f'="{cell}"' for cell in line.split(",")) for line in rows(",", ".").splitlines()]
    assert_read(read("\n".join(["MD (m),Inc,Azi", *lines])))


def report(columns, form):
    """A report of columns of text, with the names above the columns and ruled lines around them."""
    ruled = " ".join("-" * (width - 1) for _, width in columns)
    count = max(len(names) for names, _ in columns)
    heads = [
        " ".join(f"{names[k] if k < len(names) else '':<{width - 1}}" for names, width in columns) for k in range(count)
    ]
    lines = [form(k) for k in range(len(MD))]
    return "\n".join([ruled, *heads, ruled, *lines, ""])


REPORTS = {
    "number, closure and tool": report(
        [
            (("Seq", "#", "-"), 5),
            (("Measured", "depth", "(m)"), 11),
            (("Incl", "angle", "(deg)"), 8),
            (("Azimuth", "angle", "(deg)"), 9),
            (("At", "Azim", "(deg)"), 8),
            (("DLS", "(deg/", "30m)"), 7),
            (("Srvy", "tool", "type"), 8),
            (("Tool", "Corr", "-"), 7),
        ],
        lambda k: (
            f"{k:4} {MD[k]:10.2f} {INC[k]:7.2f} {AZI[k]:8.2f} {77.0:7.2f} {3.0:6.2f} "
            + ("MWD_IFR  6-axis" if k else "TIP      None")
        ),
    ),
    "date and clock": "Date       Time      MD      Inc    Azi\n                     m       deg    deg\n"
    + "".join(f"2026-03-01 {k:02}:30:00 {MD[k]:8.2f} {INC[k]:6.2f} {AZI[k]:7.2f}\n" for k in range(len(MD))),
    "directions after offsets": "  MD (m)    Incl    Azim   Latitude  Departure\n"
    + "".join(
        f"{MD[k]:9.2f} {INC[k]:6.2f} {AZI[k]:7.2f} {-north:8.2f} S {east:8.2f} E\n"
        for k, (north, east, _) in enumerate(PLACES)
    ),
}


@pytest.mark.parametrize("name", REPORTS)
def test_reports_with_columns_of_words_are_read(name):
    assert_read(read(REPORTS[name]))
