# SPDX-License-Identifier: Apache-2.0
"""
Facts about a list that its file does not state, under the same names in commands, node settings and YAML files.

The reader's messages name options of `mwd path`, such as "--confirm dogleg". For a list that is read elsewhere, such as
a plan or an offset well, `asked` rewrites the option in the form that is used there, such as "plan.confirm=dogleg".
"""

from __future__ import annotations

import dataclasses
import re

from mwd_sensors.core.settings import setting
from mwd_surface.list_files.list_columns import CONFIRMABLE, DIPS, NORTHS, Given, columns_of
from mwd_surface.list_files.list_error import ListFileError

# An option of `mwd path` in a message, with the value that the message proposes, if any.
_OPTION = re.compile(
    r"--(?P<name>columns|length-unit|angle-unit|north|decimal|dip|wellhead|confirm)\b"
    r"(?: (?P<value>[a-z_]+=[^\s;,]*(?:,[a-z_]+=[^\s;,]*)*|NORTHING,EASTING|point|comma|down|up|rad|deg|grad|ftus|ft|m|"
    rf"{'|'.join(CONFIRMABLE)})(?![\w]))?"
)
#: Form in which settings other than command options are written; field 1 is the option's name, field 2 its value.
OFFSET_WELL, NODE = "{}: {} in the entry of the offset well", "plan.{}={}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class ListSettings:
    """Facts about a list that the caller states; each replaces the statement of the file."""

    columns: str = setting(
        "",
        "Columns of the list by quantity, for example md=DEPTH,inclination=DEV,azimuth=HAZI. Set it if the names "
        "of the columns are not recognised.",
    )
    length_unit: str = setting(
        "", "Unit of the lengths if the list does not state it: m, ft (international feet) or ftus (US survey feet)."
    )
    angle_unit: str = setting("", "Unit of the angles if the list does not state it: deg, rad or grad.")
    north: str = setting(
        "",
        "North of the azimuths if the list does not state it: magnetic, true or grid.",
        choices=("", *NORTHS),
    )
    decimal: str = setting(
        "",
        "Decimal mark of the list: point or comma. Set it if a number such as 1,000 can be read in two ways.",
        choices=("", "point", "comma"),
    )
    dip: str = setting(
        "",
        "Direction of positive angles from the horizontal: down or up. Set it for a list that gives the dip of the "
        "hole.",
        choices=("", *DIPS),
    )
    wellhead: str = setting(
        "", "Northing and easting of the wellhead in the map coordinates of the list, in m, for example 6478300,431200."
    )
    confirm: str = setting(
        "",
        "Implausible values of the list that are correct, separated by commas: dogleg, wellhead, depth. Without "
        "confirmation such a list is refused.",
    )

    def given(self) -> Given:
        """
        Return the settings as facts for the list reader.

        Raises
        ------
        ValueError
            A word is unknown, or the wellhead is not two numbers.
        """
        return Given(
            columns=columns_of(self.columns),
            length_unit=self.length_unit.lower(),
            angle_unit=self.angle_unit.lower(),
            north=self.north,
            decimal=self.decimal,
            dip=self.dip,
            wellhead=_wellhead(self.wellhead),
            confirm=tuple(word.strip() for word in self.confirm.split(",") if word.strip()),
        )


def _wellhead(text: str) -> tuple[float, float] | None:
    if not text.strip():
        return None
    try:
        northing, easting = (float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"wellhead {text}: expected NORTHING,EASTING in m, e.g. 6478300,431200") from None
    return northing, easting


def asked(error: ListFileError, form: str) -> ListFileError:
    """
    Return the error with options of `mwd path` rewritten in the form that the caller of the reader can use.

    form: format string with fields for name and value, such as "plan.{}={}".
    """

    def written(found: re.Match[str]) -> str:
        return form.format(found["name"].replace("-", "_"), found["value"] or "...")

    return ListFileError(_OPTION.sub(written, str(error)))
