"""The secret in the explorer's address: in a file of its owner's, and on no command line."""

from __future__ import annotations

import http.client
import os
import re
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

BROWSER = """#!{python}
import os, shutil, sys
from urllib.parse import urlsplit
path = urlsplit(sys.argv[-1]).path
with open({told!r} + ".part", "w") as file:
    print(" ".join(sys.argv), oct(os.stat(path).st_mode), path, open(path).read(), sep="\\n", file=file)
os.replace({told!r} + ".part", {told!r})
"""


def answer(address: str, path: str, **headers: str) -> int:
    parts = urlsplit(address)
    there = http.client.HTTPConnection(parts.hostname, parts.port, timeout=20)
    there.request("GET", path, headers=headers)
    return there.getresponse().status


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="modes of files")
def test_the_browser_is_led_there_by_a_file_that_only_its_owner_reads(tmp_path: Path) -> None:
    browser, told = tmp_path / "browser", tmp_path / "told"
    browser.write_text(BROWSER.format(python=sys.executable, told=str(told)))
    browser.chmod(0o700)
    environment = {
        **os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "BROWSER": f"{browser} %s",
        "TMPDIR": str(tmp_path),
    }  # fmt: skip
    command = [sys.executable, "-m", "eppanalysis", "explore", "backlash_servo", "--port", "0", "--browser"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as explorer:
        assert explorer.stdout is not None
        try:
            address = explorer.stdout.readline().split()[0]
            end = time.monotonic() + 30.0
            while not told.exists() and time.monotonic() < end:
                time.sleep(0.05)
            arguments, mode, path, page = told.read_text().split("\n", 3)
            token = urlsplit(address).path.strip("/")
            assert token and token not in arguments
            assert stat.S_IMODE(int(mode, 8)) == 0o600
            assert re.search(r'url=([^"]+)"', page)[1] == address
            assert answer(address, urlsplit(address).path) == 200
            assert answer(address, "/favicon.ico") == 404
            assert answer(address, "/favicon.ico", Host="elsewhere.example") == 403
            assert answer(address, "/") == answer(address, "/favicon.ico/") == 403
        finally:
            explorer.send_signal(signal.SIGINT)
            explorer.wait(timeout=30)
    assert not Path(path).exists()
