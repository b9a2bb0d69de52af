# SPDX-License-Identifier: Apache-2.0
"""A table as anybody's spreadsheet writes it; what is wrong with it is named with the line."""

import random
import struct
import zlib

import pytest

from mwd_surface.list_files.table import read_table


def written(folder, text):
    path = folder / "stations.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_the_separator_is_found_by_itself(tmp_path, separator):
    path = written(tmp_path, separator.join(["md_m", "gx"]) + "\r\n" + separator.join(["1.5", "2"]) + "\r\n")
    assert read_table(path).columns() == {"md_m": ["1.5"], "gx": ["2"]}


def test_marks_comments_and_empty_lines_are_left_out(tmp_path):
    assert read_table(written(tmp_path, "\ufeff# from the tool\nmd,gx\n\n1,2\n")).columns() == {
        "md": ["1"],
        "gx": ["2"],
    }


def test_missing_cells_are_empty(tmp_path):
    assert read_table(written(tmp_path, "a,b,c\n1,2\n,,3,\n")).columns() == {
        "a": ["1", ""],
        "b": ["2", ""],
        "c": ["", "3"],
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "empty"),
        ("md,gx\n", "no row below"),
        ("md,gx,md\n1,2,3\n", "column md occurs twice"),
        ("md,gx\n1,2\n1,2,3\n", "line 3: 3 cells, but 2 columns"),
        ('md,gx\n"1,2\n', "line 2: unexpected end of data"),
        (b"%PDF-1.7", "is a PDF"),
        (random.Random(4).randbytes(5000), "binary file"),
        (zlib.compress(b"md,gx\n" + b"1,2\n" * 900), "binary file"),
        (struct.pack("<500d", *range(500)), "binary file"),
    ],
)
def test_what_is_wrong_is_reported(tmp_path, text, sentence):
    with pytest.raises(ValueError, match=sentence):
        read_table(written(tmp_path, text))
