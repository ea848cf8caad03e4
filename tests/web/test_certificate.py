"""The page over https: what a browser would object to is said at the start, and what helps."""

from __future__ import annotations

import re
import shlex
import shutil
import ssl
import subprocess
import sys
from pathlib import Path

import httpx2
import pytest

from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.web import context_of, doubts, made_by

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl here makes a certificate")


def openssl(folder: Path, command: str) -> None:
    subprocess.run(shlex.split(command), cwd=folder, check=True, capture_output=True)


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """Certificate and key, made by the line that the program itself proposes."""
    openssl(tmp_path, made_by("127.0.0.1").partition(": ")[2])
    return tmp_path / "web.crt", tmp_path / "web.key"


@pytest.mark.real_time
def test_the_page_is_served_over_https(pair: tuple[Path, Path], tmp_path: Path) -> None:
    certificate, key = pair
    command = [sys.executable, "-m", "autopilot", "web", "--link", "udpin:127.0.0.1:0", "--listen", "127.0.0.1:0"]
    web = subprocess.Popen(
        [*command, "--cert", str(certificate), "--key", str(key)], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    try:
        assert web.stdout is not None
        steer, *others = (web.stdout.readline() for _ in range(4))
        address, token = re.findall(r"(https://127.0.0.1:\d+)/#token=([\w-]{20,})", steer)[0]
        assert "no authority that this machine knows" in others[-1]
        with httpx2.Client(
            base_url=address, timeout=60.0, verify=ssl.create_default_context(cafile=certificate)
        ) as client:
            assert "Release helm" in client.get("/").text
            assert client.get("/api/may", headers={"authorization": f"Bearer {token}"}).json() == {"may": True}
        web.terminate()
        assert web.wait(60.0) == 0
    finally:
        web.kill()
        web.communicate()


def test_what_a_browser_objects_to_is_said(pair: tuple[Path, Path]) -> None:
    context = context_of(*pair, "127.0.0.1")
    assert "after you have made the certificate known" in doubts(context, pair[0], "127.0.0.1")
    wrong = doubts(context, pair[0], "192.168.1.5")
    assert "IP address mismatch" in wrong and "subjectAltName=IP:192.168.1.5" in wrong


def test_a_certificate_of_an_authority_that_is_known_raises_no_doubt(
    pair: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", str(pair[0]))
    assert doubts(context_of(*pair, "127.0.0.1"), pair[0], "127.0.0.1") == ""


def test_a_file_with_both_needs_no_key(pair: tuple[Path, Path], tmp_path: Path) -> None:
    both = tmp_path / "both.pem"
    both.write_bytes(pair[0].read_bytes() + pair[1].read_bytes())
    assert context_of(both, None, "127.0.0.1")


def test_files_that_are_none_are_refused_with_what_helps(
    pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    certificate, key = pair
    openssl(tmp_path, "openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:prime256v1 -out other.key")
    openssl(tmp_path, f"openssl pkey -in {key} -aes256 -passout pass:sea -out locked.key")
    (tmp_path / "text.crt").write_text("no certificate")
    cases = (
        (tmp_path / "none.crt", key, "no such file; one of your own is made by: openssl"),
        (certificate, tmp_path / "none.key", "--key"),
        (tmp_path / "text.crt", key, "not a certificate and its key"),
        (certificate, None, "give --key"),
        (certificate, tmp_path / "other.key", "not that of the certificate"),
        (certificate, tmp_path / "locked.key", "openssl pkey"),
    )
    for one, other, words in cases:
        with pytest.raises(InputError, match=re.escape(words)):
            context_of(one, other, "127.0.0.1")
    assert main(["web", "--link", "udpin:127.0.0.1:0", "--key", str(key)]) == 2
    assert "--cert" in capsys.readouterr().err
