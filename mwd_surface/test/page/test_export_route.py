# SPDX-License-Identifier: Apache-2.0
"""Exported files over the page: only with the token, and nothing but files of that folder."""

import json
import urllib.error
import urllib.request

import pytest

from mwd_surface.page.page_server import PageServer
from mwd_surface.page.settings import PageSettings

TOKEN = "drill-baby-drill"  # noqa: S105


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exports")
    (folder / "well 7.csv").write_text("md_m\n")
    (folder / ".hidden").write_text("secret")
    (folder.parent / "secret").write_text("secret")
    (folder / "link").symlink_to(folder.parent / "secret")
    server = PageServer(PageSettings(port=0), lambda *_: (True, ""), token=TOKEN, exports=folder)
    server.start()
    yield server
    server.stop()


def get(page, path, token=TOKEN):
    request = urllib.request.Request(page.address + path, headers={"Authorization": f"Bearer {token}"})  # noqa: S310
    try:
        with urllib.request.urlopen(request, timeout=10.0) as answer:  # noqa: S310
            return answer.status, answer.read(), dict(answer.headers)
    except urllib.error.HTTPError as error:
        return error.code, error.read(), {}


def test_the_files_are_listed_and_sent_as_downloads(page):
    status, body, _ = get(page, "exports")
    assert status == 200
    assert [(one["name"], one["bytes"]) for one in json.loads(body)["files"]] == [("well 7.csv", 5)]
    status, body, headers = get(page, "exports/well%207.csv")
    assert (status, body) == (200, b"md_m\n")
    assert headers["Content-Disposition"] == "attachment; filename*=UTF-8''well%207.csv"


@pytest.mark.parametrize("path", ["exports", "exports/well%207.csv", "exports/none"])
def test_nothing_is_told_without_the_token(page, path):
    assert get(page, path, "wrong-token-here")[0] == 401


@pytest.mark.parametrize(
    "name", [".hidden", "link", "..", "%2e%2e%2fsecret", "..%2Fsecret", "none.csv", "%00", "a%0d%0ab"]
)
def test_only_files_of_the_folder_are_sent(page, name):
    assert get(page, f"exports/{name}")[0] in (400, 404)
