"""The page in a real browser: moves, wrong input, two tabs, a phone, links, and nothing of the machine through it."""

from __future__ import annotations

import http.client
import re
import socket
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import eppanalysis as epp
from tests.explorer.browser import find_chromium, open_page, press, running_browser, running_explorer, save, wait
from tests.explorer.latency import measure

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium or Chrome is installed"),
    # What the browser's driver leaves open when its loop ends is not ours.
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

PASSWORDS = "etc/passwd"


@pytest.fixture(scope="module")
def address():
    with running_explorer(slow_pictures=False) as (address, _):
        yield address


@pytest.fixture(scope="module")
def browser():
    with running_browser() as browser:
        yield browser


@pytest.fixture
def page(browser, address):
    page = open_page(browser, address)
    yield page
    page.close()


@pytest.fixture(scope="module")
def unmoved(browser, address):
    """A page on which nothing changes, for all that changes nothing."""
    page = open_page(browser, address)
    yield page
    page.close()


def verdict(page) -> str:
    return page.evaluate("model('verdict').text")


def field(page, name: str) -> float:
    return page.evaluate("(f) => slider(f).value", name)


def set_field(page, text: str) -> None:
    page.evaluate("(t) => { model('field').value = t; }", text)


def test_a_move_changes_run_picture_and_address(page):
    assert verdict(page) == "Oscillates at 8.974 Hz, theta by 4.394 deg peak to peak."
    before = page.evaluate("pixels('nyquist')")
    press(page, "lock_pin.backlash", "PageDown", 3)
    press(page, "bands.range", "End")
    wait(page, "model('verdict').text.startsWith('Settles')")
    wait(page, "location.search.includes('bands.range=5%20lbf')")
    assert page.evaluate("pixels('nyquist')") != before


def test_what_is_shown_is_what_the_methods_say(page):
    set_field(page, "lock_pin.backlash = 1.8 deg")
    wait(page, "slider('lock_pin.backlash').value.toFixed(6) === '1.800000'")
    wait(page, "!model('verdict').text.includes('4.394')")
    case = epp.case("fig8a_original").with_values({"lock_pin.backlash": "1.8 deg"})
    cycle = epp.simulate(case.to_system(), case.input, case.t_end).limit_cycle
    assert f"{cycle.frequency:.4g} Hz" in verdict(page)


def test_slow_pictures_arrive(browser):
    with running_explorer() as (address, _):
        page = open_page(browser, address)
        slow_pictures_arrive(page)
        page.close()


def slow_pictures_arrive(page):
    wait(page, "model('map').title.text === 'Design map'", 240)
    image = "model('map').renderers.find((r) => r.glyph.type === 'Image').data_source.data.image"
    wait(page, f"{image}?.[0]?.length > 0")  # the title comes first
    codes = page.evaluate(f"Array.from({image}[0])")
    assert {1, 2} <= set(codes)
    wait(page, "model('exact').text.includes('stable 4.394 deg at 8.974 Hz')", 240)
    assert "unstable 1.162 deg at 5.183 Hz" in page.evaluate("model('exact').text")
    folds = "model('branch').renderers.find((r) => r.glyph.marker?.value === 'diamond').data_source.data.x"
    wait(page, f"{folds}.length === 1", 240)
    assert page.evaluate(f"{folds}[0]") == pytest.approx(0.9785869, abs=1e-6)
    on_map = page.evaluate("model('map').renderers.find((r) => r.glyph.marker?.value === 'diamond').data_source.data")
    assert [list(on_map["x"]), list(on_map["y"])] == [[2.5], pytest.approx([0.9785869], abs=1e-6)]


def test_undo_and_reset(page):
    set_field(page, "controller.delay = 3 ms")
    wait(page, "slider('controller.delay').value === 3")
    set_field(page, "controller.delay = 5 ms")
    wait(page, "slider('controller.delay').value === 5")
    page.get_by_role("button", name="Undo").click()
    wait(page, "slider('controller.delay').value === 3")
    wait(page, "location.search.includes('delay=3%20ms')")
    page.get_by_role("button", name="Reset", exact=True).click()
    wait(page, "slider('controller.delay').value === 1 && location.search === ''")
    page.get_by_role("button", name="Undo").click()
    wait(page, "slider('controller.delay').value === 3")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("lock_pin.backlash = 3 lbf", "the page: lock_pin.backlash is '3 lbf'; expected an angle such as '2.5 deg'."),
        (
            "lock_pin.backlash = -1 deg",
            "the page: lock_pin.backlash is '-1 deg'; expected zero or a positive number.",
        ),
        ("elbow.charm = 3", "the page: elbow.charm is 'not known'; expected a field of the case"),
        ("run.input.file = passwd", "expected a field of the case"),
        ("<img src=x onerror=alert(1)>", "expected a field of the case"),
        ("bands.range = 0.1 lbf", "bands.parking_width is '0.2 lbf'; expected less than bands.range"),
        ("x" * 300, "expected the name of a field and a quantity of ordinary length"),
    ],
)
def test_wrong_input_is_a_sentence_and_changes_nothing(unmoved, text, expected):
    page = unmoved
    before, last = verdict(page), page.evaluate("model('message').text")
    set_field(page, text)
    wait(page, f"!['', {last!r}].includes(model('message').text)")
    said = page.evaluate("model('message').text")
    assert expected in said
    assert page.get_by_role("alert").inner_text() or page.evaluate("deep(root('message'), 'div').length > 0")
    assert verdict(page) == before
    assert page.evaluate("location.search") == ""


def test_a_wrong_address_is_a_sentence_and_the_rest_of_it_holds(browser, address):
    page = open_page(browser, f"{address}?lock_pin.backlash=far&no.such=1&controller.delay=4%20ms&bands.range=%00%ff")
    assert field(page, "controller.delay") == 4
    assert field(page, "lock_pin.backlash") == 2.5
    said = page.evaluate("model('message').text")
    assert said.count("expected") == 3 and "lock_pin.backlash is 'far'" in said
    page.close()
    page = open_page(browser, f"{address}?controller.delay={'9' * 5000}")
    assert "its address is too long" in page.evaluate("model('message').text")
    page.close()


def test_a_link_restores_the_state(browser, address, page):
    set_field(page, "cable.stiffness = 5000 N/m")
    set_field(page, "forearm.prehensor_mass = 0.6 kg")
    wait(page, "location.search.includes('5000') && location.search.includes('0.6')")
    wait(page, "slider('forearm.prehensor_mass').value === 0.6")
    wait(page, "!model('verdict').text.includes('8.974')")
    other = open_page(browser, page.url)
    assert field(other, "cable.stiffness") == 5000
    assert field(other, "forearm.prehensor_mass") == pytest.approx(0.6)
    wait(page, f"model('verdict').text === {verdict(other)!r}")
    other.close()


def test_two_tabs_do_not_meet(browser, address, page):
    other = open_page(browser, address)
    set_field(page, "bands.range = 5 lbf")
    wait(page, "model('verdict').text.startsWith('Settles')")
    set_field(other, "controller.delay = 2 ms")
    wait(other, "!model('verdict').text.includes('8.974')")
    assert field(other, "bands.range") == 2.5
    assert field(page, "controller.delay") == 1
    assert "bands.range" not in other.url
    other.get_by_role("button", name="Undo").click()
    wait(other, "model('verdict').text.includes('8.974')")
    assert verdict(page).startswith("Settles")
    other.close()


@pytest.mark.parametrize("width", [360, 390])
def test_a_phone_shows_all_of_it(browser, address, width):
    page = open_page(browser, f"{address}?bands.range=9%20lbf&evil=1", width, 760)
    wait(page, "model('verdict').text.startsWith('Settles')")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("step", "nyquist", "branch", "map"):
        left, right = page.evaluate(
            "(n) => { const b = deep(root(n), 'canvas')[0].getBoundingClientRect(); return [b.left, b.right]; }", name
        )
        assert 0 <= left < right <= width
        assert right - left > 0.8 * width
    page.close()


def test_heading_legend_and_ghost_follow_the_values(page):
    now, ghost = (f"model('step').renderers[{i}].data_source.data.values[0]" for i in (0, 1))
    before = page.evaluate(f"Array.from({now})")
    wait(page, "model('heading').text === 'With the values of its file.'")
    set_field(page, "lock_pin.backlash = 1.5 deg")
    wait(page, "model('heading').text === 'With lock pin backlash 1.5 deg.'")
    labels = page.evaluate("model('step').below.find((p) => p.type === 'Legend').items.map((i) => i.label.value)")
    assert labels == ["now: lock pin backlash 1.5 deg", "before: the values of its file"]
    assert page.evaluate(f"Array.from({ghost})") == before != page.evaluate(f"Array.from({now})")
    star = page.evaluate("model('map').below.find((p) => p.type === 'Legend').items.at(-1).label.value")
    assert star.startswith("the design: 2.5, 1.5")


#: Where the design stands on the screen, and where another place of the map does.
PLACES = """(x, y) => {
  const view = [...Bokeh.index].find((one) => one.model === model('map'));
  const canvas = deep(root('map'), 'canvas')[0].getBoundingClientRect();
  const star = model('map').renderers.find((one) => one.glyph.marker?.value === 'star').data_source.data;
  const at = (x, y) => [canvas.left + view.frame.x_scale.compute(x), canvas.top + view.frame.y_scale.compute(y)];
  return [at(star.x[0], star.y[0]), at(x, y)];
}"""


def test_the_design_is_dragged_on_the_map(page):
    page.evaluate("root('map').scrollIntoView()")
    start, end = page.evaluate(f"({PLACES})(4.0, 1.0)")
    page.mouse.move(*start)
    page.mouse.down()
    for share in (0.1, 0.4, 0.7, 1.0):
        page.mouse.move(*(a + share * (b - a) for a, b in zip(start, end, strict=True)))
    page.mouse.up()
    wait(page, "location.search.includes('backlash=') && location.search.includes('bands.range=')")
    assert field(page, "bands.range") == pytest.approx(4.0, abs=0.05)
    assert field(page, "lock_pin.backlash") == pytest.approx(1.0, abs=0.05)
    wait(page, "model('verdict').text.startsWith('Settles')")
    page.get_by_role("button", name="Undo").click()
    wait(page, "slider('bands.range').value === 2.5 && slider('lock_pin.backlash').value === 2.5")


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (420, 900)])
def test_sliders_stay_in_view_and_have_names(browser, address, width, height):
    page = open_page(browser, address, width, height)
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    top, bottom, name = page.evaluate(
        "(() => { const handle = deep(document.body, '.noUi-handle')[0], box = handle.getBoundingClientRect();"
        " return [box.top, box.bottom, handle.getAttribute('aria-label')]; })()"
    )
    assert 0 <= top < bottom <= height and name == "Gain: profile range [lbf]"
    page.close()


def test_all_that_the_keyboard_comes_to_has_a_name_and_an_outline(page):
    page.keyboard.press("Tab")
    met = []
    while (
        part := page.evaluate(
            "(() => { let at = document.activeElement; while (at?.shadowRoot?.activeElement) at ="
            " at.shadowRoot.activeElement; if (!at || at === document.body) return null; const style ="
            " getComputedStyle(at), name = at.getAttribute('aria-label') || at.labels?.[0]?.textContent ||"
            " at.textContent; return [name.trim(), at.tagName, style.outlineStyle, style.outlineColor]; })()"
        )
    ) is not None:
        met.append(part)
        page.keyboard.press("Tab")
    assert len(met) > 25 and {"Undo", "Page", "Set any field", "Pan: Step response"} <= {name for name, *_ in met}
    for name, tag, outline, colour in met:
        assert name and outline != "none" and colour == "rgb(0, 114, 178)", (name, tag, outline, colour)


def test_at_night_the_page_is_dark(browser, address):
    page = open_page(browser, address)
    assert (
        page.evaluate("model('step').background_fill_color.value ?? model('step').background_fill_color") == "#ffffff"
    )
    page.emulate_media(color_scheme="dark")
    wait(page, "(model('step').background_fill_color.value ?? model('step').background_fill_color) === '#16181c'")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 24, 28)"
    page.close()


def test_the_page_is_kept_as_a_file_that_needs_no_server(browser, page, tmp_path):
    set_field(page, "lock_pin.backlash = 1.5 deg")
    wait(page, "model('heading').text.includes('1.5 deg')")
    with page.expect_download() as waiting:
        page.get_by_role("button", name="Page", exact=True).click()
    kept = save(tmp_path, waiting.value)
    (tmp_path / "kept.html").write_bytes(kept)
    alone = browser.new_page(color_scheme="dark")
    asked = []
    alone.on("request", lambda request: asked.append(request.url))
    alone.goto((tmp_path / "kept.html").as_uri())
    alone.wait_for_function("Bokeh.documents.length && Bokeh.documents[0].is_idle")
    assert (
        alone.evaluate("Bokeh.documents[0].get_model_by_name('step').renderers[0].data_source.data.time[0].length")
        > 100
    )
    assert "1.5 deg" in alone.inner_text("main")
    wait(alone, "Bokeh.documents[0].roots().every((one) => one.border_fill_color === '#16181c')", 20.0)
    assert alone.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 24, 28)"
    assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
    alone.close()


def test_case_and_picture_are_given_to_the_browser(page, tmp_path):
    set_field(page, "lock_pin.backlash = 1.5 deg")
    wait(page, "slider('lock_pin.backlash').value === 1.5 && !model('verdict').text.includes('8.974')")
    with page.expect_download() as waiting:
        page.get_by_role("button", name="Case file").click()
    text = save(tmp_path, waiting.value).decode()
    assert tomllib.loads(text)["title"]
    (tmp_path / "again.toml").write_text(text)
    assert epp.read_case(tmp_path / "again.toml").value("lock_pin.backlash") == pytest.approx(0.0261799, rel=1e-5)
    with page.expect_download(timeout=240_000) as waiting:
        page.get_by_role("button", name="Picture").click()
    assert save(tmp_path, waiting.value).startswith(b"\x89PNG")


def test_nothing_is_asked_of_any_other_machine(page, address):
    host = urlsplit(address).netloc
    assert page.asked
    assert {urlsplit(url).netloc for url in page.asked if not url.startswith(("data:", "blob:"))} == {host}


def test_a_move_is_on_the_screen_soon(page):
    """The figure on two idle cores is that of ``python -m tests.explorer.latency``; here the tests share them."""
    times = measure(page, rounds=3, between=0.1)
    assert len(times) >= 10
    assert sorted(times)[len(times) // 2] < 1500.0


def request(address: str, method: str, path: str, headers: dict[str, str] | None = None) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=10)
    try:
        connection.request(method, path, headers=headers or {})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


@pytest.mark.parametrize(
    "path",
    [
        f"/../../../../{PASSWORDS}",
        f"/%2e%2e/%2e%2e/%2e%2e/%2e%2e/{PASSWORDS}",
        f"/static/../../../../../../../../{PASSWORDS}",
        f"/static/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/%2e%2e/{PASSWORDS}",
        f"/static//{PASSWORDS}",
        f"/static/extensions/..%2f..%2f..%2f{PASSWORDS}",
        f"/static/js/..%5c..%5c{PASSWORDS}",
        "/cases/fig8a_original.toml",
        "/pyproject.toml",
    ],
)
def test_paths_lead_nowhere(address, path):
    for start in ("", urlsplit(address).path.rstrip("/")):
        status, content = request(address, "GET", start + path)
        assert status in (403, 404)
        assert b"root:" not in content and b"[project]" not in content


@pytest.mark.parametrize("method", ["PUT", "POST", "DELETE", "PATCH"])
def test_nothing_can_be_sent_to_it(address, method):
    start = urlsplit(address).path
    assert request(address, method, start)[0] in (403, 404, 405)
    assert request(address, method, f"{start}static/js/bokeh.min.js")[0] in (403, 404, 405)


def test_a_page_of_another_site_cannot_speak_to_it(address):
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Protocol": "bokeh, token",
        "Origin": "http://example.org",
    }
    path = f"{urlsplit(address).path}ws"
    assert request(address, "GET", path, upgrade)[0] == 403
    assert request(address, "GET", path, upgrade | {"Origin": address.rstrip("/")})[0] != 403


@pytest.mark.parametrize("path", ["", "ws", "static/js/bokeh.min.js", "autoload.js"])
def test_without_its_token_or_under_another_name_nothing_answers(address, path):
    """A token is new at every start; a name that leads here is what a hostile site would give this machine."""
    parts = urlsplit(address)
    token = parts.path.strip("/")
    assert len(token) >= 30
    for wrong in ("", "x/", f"{token[:-1]}/", f"{token}x/", f"{token.swapcase()}/", "%ff%00/", f"/{token}/"):
        assert request(address, "GET", f"/{wrong}{path}")[0] == 403
    for name in ("example.org", f"example.org:{parts.port}", "127.0.0.1", f"127.0.0.1.example.org:{parts.port}", ""):
        assert request(address, "GET", f"{parts.path}{path}", {"Host": name})[0] in (400, 403)
    for name in (parts.netloc, f"localhost:{parts.port}", f"LOCALHOST:{parts.port}"):
        assert request(address, "GET", f"{parts.path}", {"Host": name})[0] == 200


def messages_without_sense(address: str) -> None:
    """Over HTTP and over web sockets, with the token of the page and without it."""
    import asyncio
    import json

    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    parts = urlsplit(address)
    lines = [
        b"GARBAGE",
        b"GET / HTTP/9.9",
        b"\xff\xfe\x00",
        b"GET %s HTTP/1.1\r\nContent-Length: -5" % parts.path.encode(),
    ]
    lines += [b"POST %s HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\nZZ" % parts.path.encode(), b"A" * 100_000]
    for line in lines:
        with socket.create_connection((parts.hostname, parts.port), timeout=2) as raw, suppress(OSError):
            raw.sendall(line + b"\r\n\r\n")
            raw.shutdown(socket.SHUT_WR)
            raw.recv(100)
    page = request(address, "GET", parts.path)[1].decode()
    token = re.search(r'"token":"([^"]+)"', page).group(1)
    header = json.dumps({"msgid": "1", "msgtype": "PATCH-DOC"})

    async def speak(protocols, messages):
        asked = HTTPRequest(f"ws://{parts.netloc}{parts.path}ws", headers={"Origin": f"http://{parts.netloc}"})
        socket_ = await websocket_connect(asked, subprotocols=protocols)
        with suppress(Exception):  # it may hang up
            for message in messages:
                await socket_.write_message(message, binary=isinstance(message, bytes))
            await asyncio.wait_for(socket_.read_message(), 1)
        socket_.close()

    async def all_of_them():
        for protocols in ([], ["bokeh"], ["bokeh", "x"], ["bokeh", "e30="], ["other", token]):
            await speak(protocols, ["{}"])
        patches = (
            {"events": [{"kind": "ModelChanged", "model": {"id": "none"}, "attr": "x", "new": 1}]},
            {"events": 3},
            [],
        )
        for content in ("{", "[]", "null", '"x"', "{}", "\x00", "9" * 2000, "[" * 5000, b"\xff" * 10, "x" * 2_000_000):
            await speak(["bokeh", token], [content] * 3)
            await speak(["bokeh", token], [header, "{}", content])
        for patch in patches:
            await speak(["bokeh", token], [header, "{}", json.dumps(patch)])

    with ThreadPoolExecutor(1) as thread:  # the browser's driver has the loop of this one
        thread.submit(asyncio.run, all_of_them()).result()


def test_messages_without_sense_leave_no_traceback():
    with running_explorer("backlash_servo", slow_pictures=False) as (address, process):
        messages_without_sense(address)
        assert request(address, "GET", urlsplit(address).path)[0] == 200
        process.said.seek(0)  # what it shares with the explorer
        said = process.said.read()
    assert "Traceback" not in said and 'File "' not in said
    assert all(line.startswith("explorer: ") and len(line) < 400 for line in said.splitlines())


def test_it_listens_on_the_loopback_only(address):
    port = urlsplit(address).port
    table = Path("/proc/net/tcp")
    if not table.exists():
        pytest.skip("the table of listening sockets is Linux's")
    rows = [line.split() for line in table.read_text().splitlines()[1:]]
    listening = [local for _, local, _, state, *_ in rows if state == "0A" and int(local.split(":")[1], 16) == port]
    assert listening == [f"0100007F:{port:04X}"]
    wide = Path("/proc/net/tcp6").read_text() if Path("/proc/net/tcp6").exists() else ""
    assert f":{port:04X} 0000" not in wide


def test_a_loop_has_its_own_sliders(browser):
    with running_explorer("backlash_servo", slow_pictures=False) as (address, _):
        page = open_page(browser, address)
        assert (
            page.evaluate(
                "[...Bokeh.documents[0].roots()].filter((r) => r.tags.length && r.start !== undefined).length"
            )
            == 2
        )
        set_field(page, "play.gap = 4")
        wait(page, "slider('play.gap').value === 4")
        wait(page, "/x by 7.8\\d+ peak to peak/.test(model('verdict').text)")
        page.close()


def test_sliders_show_numbers_however_small_and_curves_are_bright_by_night(browser):
    with running_explorer("robot_servo", slow_pictures=False) as (address, _):
        page = open_page(browser, address)
        titles = "[...deep(document.body, '.bk-slider-title')].map((node) => node.textContent)"
        assert {"motor inertia [kg·m²]: 1e-7", "motor torque constant [N·m/A]: 0.004"} <= set(page.evaluate(titles))
        cut = "[...deep(document.body, '.bk-slider-title')].filter((n) => n.scrollWidth > n.clientWidth + 1).length"
        assert page.evaluate(cut) == 0
        colour = "model('step').renderers.map((r) => r.glyph.line_color.value)"
        for scheme, blue in (("dark", "#56B4E9"), ("light", "#0072B2")):
            page.emulate_media(color_scheme=scheme)
            wait(page, f"{colour}.includes('{blue}')")
        page.close()


def test_a_port_in_use_and_a_missing_case_are_one_sentence():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        call = [sys.executable, "-m", "eppanalysis", "explore", "fig8a_original", "--no-browser", "--port", port]
        result = subprocess.run(call, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr.strip().startswith(f"--port {port}: cannot be used")
    assert "Traceback" not in result.stderr
