# SPDX-License-Identifier: Apache-2.0
"""
Quantities and units of the columns of a station list, from the column names or from the caller.

The whole name is read: its quantity, its unit ("MD (usft)", md_ft, "Inc °"), its north ("AZIM_GN"), and whether an
angle is measured from the horizontal. A word of the name that is not recognised is kept and quoted, never skipped. The
unit of a length is never guessed; angles without a unit are degrees.
"""

from __future__ import annotations

import dataclasses
import math
import re
import unicodedata
from collections.abc import Mapping, Sequence

from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import words_of

NEEDED = ("md", "inclination", "azimuth")
# Reference values in lists written by this program, with their factor to T and m/s^2; None for angles.
FIGURES = {"b_reference": 1e-9, "g_reference": 1.0, "dip_reference": None, "declination": None, "convergence": None}
ANGLES = (
    *("inclination", "dip", "azimuth", "sigma_inclination", "sigma_azimuth"),
    *(n for n, f in FIGURES.items() if not f),
)
TEXTS = ("azimuth_reference", "tool", "time", "date", "verdict", "station", "coordinates", "in_use", "leg")
NORTHS = ("true", "grid", "magnetic")
DIPS = ("down", "up")  # direction in which positive angles from the horizontal point
# Words that state the direction of positive angles in the name of a column, or in a line of the head.
_POINTS = {
    "up": re.compile(r"\bup(?:wards?)?\b|上倾|上仰|上为正|上正|向上|仰角为正|仰为正"),
    "down": re.compile(r"\bdown(?:wards?)?\b|下倾|下俯|下为正|下正|向下|俯角为正|俯为正"),
}
CONFIRMABLE = ("dogleg", "wellhead", "depth")

# Units of length by their names, with factors to m. The US survey foot is 1200/3937 m.
LENGTH_UNITS = {
    name: factor
    for names, factor in (
        ("m|meter|metre|meters|metres|mtr|mtrs|米|м|метр|метры|metros|metri", 1.0),
        ("ft|f|feet|foot|fti|ift|international feet|intl feet|英尺|pies|pieds|fuss", 0.3048),
        ("ftus|usft|us ft|ft us|usfeet|us feet|feet us|us foot|survey feet|survey ft|us survey feet", 1200.0 / 3937.0),
        ("us survey foot|us survey ft|survey foot|ftus survey|sft|ussft", 1200.0 / 3937.0),
        ("km|kilometer|kilometers|kilometre|kilometres|км", 1000.0),
        ("cm|centimeter|centimeters|centimetre|centimetres", 0.01),
        ("mm|millimeter|millimeters|millimetre|millimetres", 0.001),
        ("inch|inches", 0.0254),
        ("yd|yds|yard|yards", 0.9144),
    )
    for name in names.split("|")
}
# Units of lengths and angles that only WITSML uses, with their factors to m and rad. Source: Energistics Unit of
# Measure Standard 1.0; the old feet from the EPSG dataset.
ENERGISTICS_UNITS = {
    "in": 0.0254,
    "dm": 0.1,
    "mi": 1609.344,
    "fathom": 1.8288,
    "chain": 20.1168,
    "ftUS": 1200.0 / 3937.0,
    "inUS": 100.0 / 3937.0,
    "ydUS": 3600.0 / 3937.0,
    "miUS": 5280.0 * 1200.0 / 3937.0,
    "ftCla": 0.3047972654,
    "ftSe": 0.304799471538676,
    "ftSe(t)": 0.304799333333333,
    "ftBnA": 0.304799733333333,
    "ftBnB": 0.304799734763271,
    "ftGC": 0.304799710181509,
    "ftInd": 0.304799510248147,
    "ftInd(37)": 0.30479841,
    "ftInd(62)": 0.3047996,
    "ftInd(75)": 0.3047995,
    "ft[US]": 1200.0 / 3937.0,
    "ft[Cla]": 0.3047972654,
    "ft[Se]": 0.304799471538676,
    "ft[Ind]": 0.304799510248147,
    "in[US]": 100.0 / 3937.0,
    "yd[US]": 3600.0 / 3937.0,
    "mi[US]": 5280.0 * 1200.0 / 3937.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "mina": math.pi / 10_800.0,
    "seca": math.pi / 648_000.0,
    "min[angl]": math.pi / 10_800.0,
    "sec[angl]": math.pi / 648_000.0,
    "cgr": math.pi / 20_000.0,
    "c": math.tau,
    "rev": math.tau,
    "rot": math.tau,
}
ENERGISTICS_ANGLES = frozenset(["mrad", "urad", "mina", "seca", "min[angl]", "sec[angl]", "cgr", "c", "rev", "rot"])
ANGLE_UNITS = {
    name: factor
    for names, factor in (
        ("deg|dega|degs|degree|degrees|decimal degrees|dd|度|grader|graden|grados|graus|gradi", math.pi / 180.0),
        ("degre|degres|град|градус|градусы", math.pi / 180.0),
        ("rad|rads|radian|radians|弧度", 1.0),
        ("grad|gon|grads|gradians|gons|gradian", math.pi / 200.0),
    )
    for name in names.split("|")
}
# Names of depth datums, and other words after a unit or depth that do not change its meaning.
_DATUMS = words_of(
    "kb|rkb|rt|drt|brt|bkb|bdf|df|rte|dfe|kbe|gl|rotary|table|kelly|bushing|bushings|floor|drill|derrick|md|tvd|ah|"
    "along|hole|below|from|datum|zdp|mdrkb|mdkb|mdrt|mdbrt|tvdrkb|tvdkb|tvdrt|tvdbrt"
)
_NORTH_WORDS = {
    **dict.fromkeys(("true", "tn", "geographic", "geo", "truenorth", "vrai", "wahr", "真", "真北", "真方位"), "true"),
    **dict.fromkeys(("grid", "gn", "map", "gridnorth", "网格", "坐标", "坐标北", "网格方位"), "grid"),
    **dict.fromkeys(("magnetic", "mag", "mn", "magn", "compass", "magneticnorth", "磁", "磁北", "磁方位"), "magnetic"),
}
# Stems of words for a north in languages that inflect them.
_NORTH_STEMS = {
    **dict.fromkeys(("geograf", "geograph", "rechtweisend", "verdader", "verdadeir", "истинн", "географ"), "true"),
    **dict.fromkeys(("gitter", "rutenett", "cuadricul", "quadricul", "quadrill", "дирекцион", "картограф"), "grid"),
    **dict.fromkeys(("magnet", "missweisend", "магнит"), "magnetic"),
}
_DENIALS = words_of("not|no|non|never|without|uncorrected|nicht|ohne")
_CORRECTED = ("declin", "uncorrect", "converg", "磁偏角", "收敛角")
_LETTERS = {"t": "true", "g": "grid", "m": "magnetic"}  # letters after the unit of an azimuth
# Words that do not change the meaning of a column name.
_FILLERS = words_of(
    "in|survey|svy|station|bh|drillhole|drill|sta|stn|borehole|wellbore|hole|well|angle|corrected|corr|cor|final|"
    "value|reading|point|the|of|at|to|north|rel|relative|referenced|reference|ref|decimal|actual|measured|calculated|"
    "calc|computed|vertical|down|positive|角"
)
_HORIZONTAL = words_of("horizontal|horiz|horizon|hor|水平|水平面")
_WORDS = {
    "md": (
        "md|measured depth|meas depth|m depth|mdepth|depth|dept|depth md|along hole depth|ahd|tmd|dmd|survey depth|"
        "hole depth|mdrkb|mdkb|mdrt|mdbrt|mddf|meas d|tape depth|drilled depth|total measured depth|"
        "distance along hole|"
        "孔深|井深|测深|钻深|斜深|深度|测量深度|测点深度|钻孔深度|measured|teufe|messteufe|bohrteufe|tiefe|messtiefe|"
        "bohrlochlange|bohrlochtiefe|bohrlochteufe|profundidad|profundidad medida|profundidade|profundidade medida|"
        "profondeur|profondeur mesuree|profondeur foree|cote foree|profondita|profondita misurata|diepte|"
        "gemeten diepte|diepte langs boorgat|dybde|malt dybde|dybde md|dyp|malt dyp|глубина|глубина по стволу|"
        "измеренная глубина|глубина замера|m d|dmea|dpth|station depth|hole length|sensor depth|sensor md"
    ),
    "inclination": (
        "inc|incl|inclination|devi|dev|deviation|drift|drift angle|zenith|zenith angle|incln|inclin|hole angle|"
        "井斜|井斜角|顶角|天顶角|neigung|neigungswinkel|inklination|inklinasjon|inkl|inclinacion|inclinacao|inclinaison|"
        "inclinazione|inclinatie|зенитный угол|зенит|инклинация"
    ),
    "dip": (
        "dip|dip angle|hole dip|pitch|pitch angle|plunge|elevation angle|angle from horizontal|倾角|倾斜角|"
        "dip up|dip down|hole dip up|hole dip down|"
        "仰俯角|仰角|俯仰角|俯仰|俯角|einfallen|fallen|buzamiento|plongement|falling angle"
    ),
    "azimuth": (
        "azi|azim|azimuth|az|azm|azmth|azimut|hazi|direction|hole direction|bearing|方位|方位角|acimut|азимут|"
        "azimuth angle|azimute|asimut|richtung|retning|drift azimuth|drift direction|drift dir|bore azimuth|dir"
    ),
    "tvd": (
        "true vert depth|true vert|tvd|tvd depth|vertical depth|true vertical depth|"
        "vert depth|tv depth|v depth|vdepth|tvdrkb|tvdkb|tvdrt|tvdbrt|tvdd|垂深|"
        "垂直深度|vertical|true vertical|teufe senkrecht|senkrechte teufe|vertikale teufe|vertikalteufe|seigerteufe|"
        "vertikal dybde|vertikaldybde|profondeur verticale|profundidad vertical|profundidad vertical verdadera|"
        "profundidade vertical|profondita verticale|verticale diepte|вертикальная глубина|глубина по вертикали"
    ),
    "north": (
        "north|ns|n s|disp ns|displ ns|"
        "n|local north|north offset|offset north|n offset|local n|dy|delta north|north south|"
        "y offset|n s offset|ns offset|latitude ns|lat ns|northings local|local northing|local northings|"
        "north displacement|displacement north|南北位移|北位移|北坐标"
    ),
    "east": (
        "east|ew|e w|disp ew|displ ew|"
        "e|local east|east offset|offset east|e offset|local e|dx|delta east|east west|x offset|"
        "e w offset|ew offset|departure|local easting|local eastings|east displacement|displacement east|东西位移|"
        "东位移|东坐标"
    ),
    "map_north": (
        "northing|northings|y|y coordinate|y coord|map north|map northing|grid northing|utm n|utm north|utm y|hochwert"
    ),
    "map_east": (
        "easting|eastings|x|x coordinate|x coord|map east|map easting|grid easting|utm e|utm east|utm x|rechtswert"
    ),
    "sigma_inclination": "sigma inclination",
    "sigma_azimuth": "sigma azimuth",
    "b_reference": "b reference nt",
    "g_reference": "g reference mps",
    "dip_reference": "dip reference",
    "declination": "declination",
    "convergence": "convergence",
    "azimuth_reference": "azimuth reference|azi ref|azi reference|azimuth ref|az ref|azi type|azimuth type|"
    "azimuth north|north reference|north ref|north type|azimuth north reference",
    "tool": "tool code|survey tool|tool|station type|survey type|survey tool code",
    "time": "time|time utc|dtim|dtim utc|dtim stn|date time|datetime|timestamp",
    "date": "date|survey date|datum|fecha|dato|data|日期",
    "verdict": "verdict|automatic",
    "station": "station",
    "coordinates": "coordinates",
    "in_use": "in use",
    "leg": "leg",
}
_NAMES = {name: what for what, names in _WORDS.items() for name in names.split("|")}
# Names that count only if they are the whole name: "well", but not "well depth". "" stands for the direction from the
# wellhead to a station, which is not an azimuth of the hole.
_WHOLE = {
    name: what
    for what, names in {
        "verdict": "status|survey status|station status|qc|survey qc|qc status|qc flag|qc result|quality|"
        "survey quality|flag|accept reject|accepted rejected|good bad|pass fail",
        "": "at azim|at azi|at azimuth",
        "in_use": "use|used|accept|accepted|survey accepted|good|ok|valid|include|included|qc pass|qc passed|pass",
        "leg": "hole|hole id|holeid|hole name|hole no|hole number|bhid|dhid|borehole|borehole id|drillhole|"
        "drillhole id|wellbore|wellbore name|well|well name|uwi|leg name|孔号",
    }.items()
    for name in names.split("|")
}
_DIRECTED = {
    **dict.fromkeys(("真方位", "真方位角", "真北方位角", "地理方位角"), "true"),
    **dict.fromkeys(("磁方位", "磁方位角", "磁北方位角"), "magnetic"),
    **dict.fromkeys(("坐标方位", "坐标方位角", "网格方位", "网格方位角", "дирекционный угол"), "grid"),
}
# Chinese words before a quantity that do not change it: of the borehole, measured, at the station, drilled, total.
_BEFORE = ("钻孔", "实测", "测量", "测点", "钻进", "累计", "孔")
# Quantities that are not read although their names contain a word of a quantity that is read; they cause no remark.
_OTHERS = re.compile(
    r"\bage\b|\bfirst\b|"
    r"section|vsec|closure|rate|dogleg|dls|build|turn|walk|tvdss|sstvd|sub ?sea|mtvdss|latitude|longitude|"
    r"tool ?face|magnetic field|gravity|temp|limit|sigma|uncert|target|plan|course|elevation|bit depth|total|reference|"
    r"method|raw|quality|status|comment|remark|note|name|number|index|declination|convergence|ellipse"
)
_LENGTHS = ("md", "tvd", "north", "east", "map_north", "map_east")
_SUBSEA = words_of("ss|tvdss|mtvdss|subsea|sub|sea|msl|mtvd|lat")
_OF_THE_HOLE = re.compile(r"\bhole (?:depth|length)\b|\btotal measured depth\b")
# Words after an angle that make another quantity of it, such as its error.
_OF_AN_ANGLE = words_of("err|error|unc|uncertainty|sd|std|stdev|sigma|delta|diff|difference|change|rate|correction")
_KEYS = re.compile(
    r"\bbad\b|reject|exclu|azi|asim|incl|inclin|inkl|depth|\btvd|north|east|方位|深|倾|глубин|азимут|угол"
)


@dataclasses.dataclass(frozen=True)
class Given:
    """Facts about a list that the caller states; they replace the statements of the file."""

    #: quantity (md, inclination, dip, azimuth, tvd, north, east ...) -> name of its column. An empty name means that
    #: the quantity is not read.
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)
    #: `length_unit`, `angle_unit`, `north`: unit of lengths (of LENGTH_UNITS), unit of angles (of ANGLE_UNITS) and
    #: north of azimuths. Each replaces the statement of the file; if empty, the file decides.
    length_unit: str = ""
    angle_unit: str = ""
    north: str = ""
    decimal: str = ""  #: "point" or "comma"; empty: inferred from the cells
    #: direction of positive angles from the horizontal, "down" or "up"; empty: inferred from the vertical depths
    dip: str = ""
    #: northing and easting of the wellhead, in m, subtracted from map coordinates
    wellhead: tuple[float, float] | None = None
    #: words of `CONFIRMABLE` for implausible values that the caller has checked and that are correct
    confirm: tuple[str, ...] = ()
    #: usual direction of positive angles from the horizontal in the well; used if neither the caller nor the list nor
    #: its vertical depths determine the direction
    usual_dip: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError for an unknown quantity, unit, north, decimal mark, direction of dip or confirmed word."""
        for value, known, what in (
            *((name, tuple(_WORDS), "columns") for name in self.columns),
            (self.length_unit, tuple(LENGTH_UNITS), "length unit"),
            (self.angle_unit, tuple(ANGLE_UNITS), "angle unit"),
            (self.north, NORTHS, "north"),
            (self.decimal, ("point", "comma"), "decimal mark"),
            (self.dip, DIPS, "dip"),
            *((word, CONFIRMABLE, "confirm") for word in self.confirm),
        ):
            if value and value not in known:
                raise ValueError(f"unknown {what} {value!r}; choose one of {', '.join(known)}")

    def with_dip(self, way: str) -> Given:
        """Return a copy of these facts with `usual_dip` set to `way`."""
        return dataclasses.replace(self, usual_dip=way)


def columns_of(text: str) -> dict[str, str]:
    """
    Return quantities and their column names from a user's text such as "md=DEPTH,inc=DEV,azi=HAZI".

    Raises
    ------
    ValueError
        A part of the text has no "=".
    """
    pairs = {}
    for part in filter(None, text.split(",")):
        name, equals, column = part.partition("=")
        if not equals:
            raise ValueError(f"columns {text}: write it as md=NAME,inclination=NAME,azimuth=NAME")
        name = name.strip()
        pairs[{"inc": "inclination", "azi": "azimuth"}.get(name, name)] = column
    return pairs


@dataclasses.dataclass(frozen=True)
class ListColumn:
    """One column: its index, its name, and its quantity ("" if the list reader does not read this quantity)."""

    number: int
    name: str
    quantity: str
    #: `unit`, `north`: unit and north that the name states, or ""
    unit: str = ""
    north: str = ""
    strange: str = ""  #: words of the name that were not recognised


@dataclasses.dataclass(frozen=True)
class ListColumns:
    """
    Columns of a list by quantity, in the order of the file.

    `unread` holds the columns that resemble a quantity but are not read.
    """

    of: Mapping[str, tuple[ListColumn, ...]]
    unread: tuple[ListColumn, ...] = ()

    @property
    def missing(self) -> list[str]:
        """Quantities that every list needs and this list does not have."""
        return [what for what in NEEDED if what not in self.of and not (what == "inclination" and "dip" in self.of)]


def find(names: Sequence[str], given: Given | None = None, units: Sequence[str] = ()) -> ListColumns:
    """
    Return the columns of a list by quantity, and the columns that resemble a quantity but are not read.

    names: names of the columns. given: statements of the caller. units: units that the file states apart from the
    names, as LAS does.
    """
    given = given or Given()
    of: dict[str, tuple[ListColumn, ...]] = {}
    unread = []
    chosen_names = {column.strip().lower(): q for q, column in given.columns.items() if column.strip()}
    for k, name in enumerate(names):
        unit = units[k] if k < len(units) else ""
        column = column_of(k, name, unit)
        chosen = chosen_names.get(name.strip().lower())
        if chosen:
            column = column if column.quantity == chosen else column_of(k, name, unit, chosen)
        elif column.quantity in given.columns:
            continue
        if column.quantity:
            of[column.quantity] = (*of.get(column.quantity, ()), column)
        elif _resembles(name):
            unread.append(column)
    measured = tuple(one for one in of.get("md", ()) if not _OF_THE_HOLE.search(_words(one.name)))
    if measured:
        # The depth of the hole at the time of a survey is not the depth of the survey.
        of["md"] = measured
    directed = tuple(one for one in of.get("dip", ()) if points(one.name))
    if directed:
        # If a dip column states its direction, other dip columns are those of the magnetic field.
        of["dip"] = directed
    if "inclination" in of:
        # A list with inclinations may also have the dip of the magnetic field.
        of.pop("dip", None)
    return ListColumns(of, tuple(unread))


def column_of(number: int, name: str, unit: str = "", chosen: str = "") -> ListColumn:
    """
    Return the quantity, unit and north that a column name states.

    number: index of the column. unit: unit that the file states apart from the name. chosen: quantity that the caller
    assigns; the other words of the name are then ignored, except for a unit and a north.
    """
    base, brackets = _parted(name)
    # "in" means inch if it stands alone as a unit; elsewhere it is a preposition.
    brackets = ["inch" if phrase == "in" else phrase for phrase in brackets]
    unit = "inch" if unit.strip(" .()[]").lower() == "in" else unit
    words = base.split()
    quantity, rest, north = (_WHOLE[base], [], "") if base in _WHOLE else _quantity(words)
    if chosen:
        quantity, north = chosen, ""
        rest = [word for word in words if _north_word(word) or (len(word) > 1 and unit_word(word))]
    angle = quantity in ANGLES
    own, turned, horizontal, behind = _qualifiers(" ".join(rest), angle=angle)
    north, strange = turned or north, list(behind)
    for phrase in (*brackets, _words(unit)):
        found, turned, flat, left = _qualifiers(phrase, angle=angle)
        own, north, horizontal = found or own, turned or north, flat or horizontal
        strange += left
    if quantity == "inclination" and horizontal:
        quantity = "dip"
    if quantity in _LENGTHS and (behind or "angle" in rest or (quantity == "tvd" and _SUBSEA & set(strange))):
        # "Depth Limit", "Vertical Section", "TVD (SS)" begin like a quantity that is read but are other quantities.
        quantity = ""
    if angle and _OF_AN_ANGLE & {*rest, *behind}:
        quantity = ""
    if unit.strip() and not own and quantity and quantity not in TEXTS and not strange:
        strange = [unit.strip()]
    return ListColumn(number, name.strip(), quantity, own, north, " ".join(strange))


def points(text: str) -> str:
    """
    Return the direction of positive angles from the horizontal in a text, one of DIPS.

    The result is "" if the text states no direction, or both.
    """
    words = _words(text)
    found = [way for way, pattern in _POINTS.items() if pattern.search(words)]
    return found[0] if len(found) == 1 else ""


def unit_word(text: str) -> str:
    """Return the unit in a text as a key of LENGTH_UNITS or ANGLE_UNITS; "" if the text is not a unit."""
    words = [w for w in _words(text).split() if w not in _DATUMS]
    joined = " ".join(words)
    if joined in LENGTH_UNITS or joined in ANGLE_UNITS:
        return joined
    whole = _words(text).replace(" ", "")
    for unit in sorted(LENGTH_UNITS, key=len, reverse=True):
        # Units joined with a datum, such as ftKB, mRKB, mMD.
        if whole.startswith(unit) and whole[len(unit) :] in _DATUMS:
            return unit
    return ""


def _north_word(word: str) -> str:
    """Return the north that one word names; "" if it names none."""
    stem = next((north for stem, north in _NORTH_STEMS.items() if word.startswith(stem)), "")
    return _NORTH_WORDS.get(word, stem)


def is_datum_or_north(text: str) -> bool:
    """Return whether all words of a text are datums or norths, as in a line of units below the column names."""
    words = _words(text).split()
    return bool(words) and all(word in _DATUMS or _north_word(word) for word in words)


def north_of(text: str) -> str:
    """
    Return the north that a text names, one of NORTHS; "" if it names none.

    If the text names two norths, as in "from magnetic to true north", the north after "to" counts. A denial, as in "not
    corrected to true north", names no north.
    """
    words = _words(text).split()
    if _DENIALS & set(words) or any(word[0] in "未不" for word in words):
        return ""
    to = max((k for k, word in enumerate(words) if word in ("to", "into", "auf", "vers")), default=0)
    for part in (words, words[to:] if to else []):
        found = {_north_word(w) for w in part} - {""}
        if len(found) == 1:
            return found.pop()
    return ""


def mentions_north(text: str) -> bool:
    """Return whether a text contains a word for a north, or a word for a correction of azimuths to a north."""
    words = _words(text).split()
    return any(_north_word(word) or any(stem in word for stem in _CORRECTED) for word in words)


def factor(column: ListColumn, at: str, given: Given | None = None, otherwise: str = "") -> float:
    """
    Return the factor that converts a column to SI units: m, rad, T or m/s^2.

    at: place of the column in the file. given: units that the caller states; they replace the unit of the column.
    otherwise: unit from the head of the list, for a column without a unit. An angle without any unit is in deg.

    Raises
    ------
    ListFileError
        A length has no unit, or a unit or word is not recognised.
    """
    own = FIGURES.get(column.quantity)
    if own is not None:
        return own
    angle = column.quantity in ANGLES
    known = ANGLE_UNITS if angle else LENGTH_UNITS
    said = "" if given is None else given.angle_unit if angle else given.length_unit
    if said:
        return known[said]
    option = "--angle-unit" if angle else "--length-unit"
    usual = "deg, rad or grad" if angle else "m, km, ft, usft, inch or yd"
    if column.strange and not column.unit and column.quantity != "azimuth":
        raise ListFileError(
            f"{at}: {column.quantity} in {column.strange!r} (column {column.name!r}): the unit was not"
            f" recognised; expected {usual}; set it with {option}, or name the column with --columns"
        )
    unit = column.unit or otherwise or ("deg" if angle else "")
    if not unit:
        raise ListFileError(
            f"{at}: {column.quantity} (column {column.name!r}) has no unit; write {column.quantity}_m or"
            f" {column.quantity}_ft, or set the unit with --length-unit"
        )
    if unit not in known:
        raise ListFileError(f"{at}: {column.quantity} in {unit!r}; expected {usual}")
    return known[unit]


def _plain(letter: str) -> str:
    """Return a Latin letter without its accents; other letters unchanged."""
    base = unicodedata.normalize("NFKD", letter)[:1]
    return base if base.isascii() and base.isalpha() else letter


def _words(text: str) -> str:
    """Return a text in lower case with single spaces, degree signs as words, without other signs and Latin accents."""
    text = text.replace("Â°", "°")
    for sign in "°º˚":
        text = text.replace(sign, " deg ")
    text = "".join(_plain(c) for c in unicodedata.normalize("NFKC", text).casefold())
    return " ".join("".join(c if c.isalpha() or unicodedata.combining(c) else " " for c in text).split())


def _parted(name: str) -> tuple[str, list[str]]:
    """Return the words of a name outside its brackets, and the words inside each bracket."""
    name = unicodedata.normalize("NFKC", name.replace("Â°", "°").replace("º", "°").replace("˚", "°"))
    name = re.sub(r"\+?\s*\bN(\s*\(\+\))?\s*/\s*-?\s*S\b(\s*\(-\))?", " ns ", name, flags=re.IGNORECASE)
    name = re.sub(r"\+?\s*\bE(\s*\(\+\))?\s*/\s*-?\s*W\b(\s*\(-\))?", " ew ", name, flags=re.IGNORECASE)
    brackets = re.findall(r"[(\[{<]([^)\]}>]*)[)\]}>]?", name)
    base = re.sub(r"[(\[{<][^)\]}>]*[)\]}>]?", " ", name)
    return _words(base), [w for w in map(_words, brackets) if w]


def _quantity(words: Sequence[str]) -> tuple[str, list[str], str]:
    """Return the quantity that the first words name ("" if none), the words after them, and the north in the words."""
    # Find the longest name of a quantity at the beginning, then a name after a north or a filler word.
    for size in range(len(words), 0, -1):
        joined = " ".join(words[:size])
        if joined in _NAMES:
            return _NAMES[joined], list(words[size:]), ""
        if joined in _DIRECTED:
            return "azimuth", list(words[size:]), _DIRECTED[joined]
    for word in _BEFORE:
        if words and words[0].startswith(word) and words[0] != word:
            found = _quantity([words[0].removeprefix(word), *words[1:]])
            if found[0]:
                return found
    before = next((k for k, word in enumerate(words) if not _north_word(word) and word not in _FILLERS), 0)
    if before == 0:
        return "", list(words), ""
    north = next((_north_word(word) for word in words[:before] if _north_word(word)), "")
    quantity, rest, own = _quantity(words[before:])
    if north and quantity != "azimuth":
        return "", list(words), ""
    return quantity, rest, own or north


def _qualifiers(phrase: str, *, angle: bool) -> tuple[str, str, bool, list[str]]:
    """
    Return the meaning of the words around a name.

    The results are unit and north ("" if none), whether the angle is from the horizontal, and the unknown words.
    """
    unit, north, horizontal = unit_word(phrase), "", False
    if unit and not (angle and unit in LENGTH_UNITS):
        return unit, "", False, []
    unit = ""
    left: list[str] = []
    words = phrase.split()
    k = 0
    while k < len(words):
        size = next((n for n in (3, 2, 1) if unit_word(" ".join(words[k : k + n])) and k + n <= len(words)), 0)
        word = words[k]
        if angle and unit and word in _LETTERS:
            # Letters after a unit, as in "°T" and "deg M".
            north, k = _LETTERS[word], k + 1
            continue
        if size:
            unit, k = unit or unit_word(" ".join(words[k : k + size])), k + size
            continue
        if word in _HORIZONTAL:
            horizontal = True
        elif angle and _north_word(word):
            north = _north_word(word)
        elif angle and word in _LETTERS and word not in LENGTH_UNITS:
            north = _LETTERS[word]
        elif word not in _FILLERS and word not in _DATUMS and not (angle and points(word)):
            left.append(word)
        k += 1
    return unit, north, horizontal, left


def _resembles(name: str) -> bool:
    """Return whether a name that is not recognised contains a word that occurs in the names of the quantities read."""
    words = _words(name)
    return bool(_KEYS.search(words)) and not _OTHERS.search(words)
