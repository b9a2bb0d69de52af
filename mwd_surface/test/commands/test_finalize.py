# SPDX-License-Identifier: Apache-2.0
"""`mwd finalize`: the files agree with each other, and the certificate with the files."""

import csv
import hashlib
import io
import json
import resource
import sys

import example_surveys as example
import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

import bombs
from mwd_surface import cli
from mwd_surface.surveys.survey_source import surveys_of
from mwd_surface.surveys.survey_store import encoded


def mwd(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["mwd", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code or 0


@pytest.mark.slow
def test_the_files_of_a_final_list_agree_and_its_certificate_is_of_them(tmp_path, monkeypatch):
    run = tmp_path / "run"
    run.mkdir()
    (run / "surveys.json").write_bytes(encoded(example.surveys()))
    key = Ed25519PrivateKey.generate()
    pem = tmp_path / "office.pem"
    pem.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    out = tmp_path / "final"
    assert mwd(monkeypatch, "finalize", f"{run}=MWD+SRGM", "-o", out, "--key", pem) == 0
    content = (out / "certificate.json").read_bytes()
    certificate = json.loads(content)
    for one in certificate["outputs"]:
        assert hashlib.sha256((out / one["file"]).read_bytes()).hexdigest() == one["sha256"]
    (source,) = certificate["inputs"]
    assert source["sha256"] == hashlib.sha256((run / "surveys.json").read_bytes()).hexdigest()
    signature = (out / "certificate.sig").read_bytes()
    key.public_key().verify(signature, content)
    with pytest.raises(InvalidSignature):
        key.public_key().verify(signature, content + b" ")
    # The list can be read again, with its programme, by every command.
    surveys, _ = surveys_of(out)
    assert [r.survey.uuid for r in surveys.records] == [r.survey.uuid for r in example.surveys().records]
    text = (out / "definitive.csv").read_text(encoding="utf-8")
    rows = list(csv.DictReader(io.StringIO("".join(line + "\n" for line in text.splitlines() if line[:1] != "#"))))
    assert {row["sequence"] for row in rows if row["sequence"]} == {
        str(r.survey.sequence) for r in surveys.records if r.in_use
    }
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "Final list against the list as first decided" in report
    assert source["sha256"] in report
    assert (out / "report.pdf").read_bytes().startswith(b"%PDF")


# "endless" is a file of ten gigabytes.
@pytest.mark.parametrize("kind", ["text", *bombs.PLACES, *bombs.FILES])
def test_a_key_that_cannot_sign_is_refused_before_anything_is_written(kind, tmp_path, monkeypatch, capsys):
    (tmp_path / "surveys.json").write_bytes(encoded(example.surveys()))
    key = tmp_path / "wrong.pem"
    {"text": lambda path: path.write_text("no key"), **bombs.PLACES, **bombs.FILES}[kind](key)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert mwd(monkeypatch, "finalize", f"{tmp_path}=MWD+SRGM", "-o", tmp_path / "out", "--key", key) != 0
    assert str(key) in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB
