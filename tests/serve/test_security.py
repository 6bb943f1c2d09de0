"""Each measure against another page, another user, and a hostile log; each fails without its measure."""

from __future__ import annotations

import asyncio
import dataclasses
import socket
from collections.abc import AsyncIterator
from hashlib import sha256
from pathlib import Path
from urllib.parse import quote

import pytest

from quadid_logs.errors import SettingsError
from quadid_logs.serve import server as server_module
from quadid_logs.serve.entries import log_entry
from quadid_logs.serve.server import ServeSettings, serve
from quadid_logs.serve.upload import UploadError, Uploads
from tests.serve.asgi import OWN, PORT, SHA, Site, site


def listened(settings: ServeSettings) -> list[str]:
    """Return the addresses that would be listened on."""
    sockets = server_module._listening(settings.host, settings.port)
    addresses = [each.getsockname()[0] for each in sockets]
    for each in sockets:
        each.close()
    return addresses


def test_it_listens_on_loopback_addresses_only(tmp_path: Path) -> None:
    """Whoever is on the same network finds nothing."""
    assert set(listened(ServeSettings(folder=tmp_path, port=0))) <= {"127.0.0.1", "::1"}


@pytest.mark.parametrize("token", ["", "short"])
def test_another_address_needs_a_token_that_the_owner_chose(tmp_path: Path, token: str) -> None:
    """An option alone does not open the logs to a network."""
    with pytest.raises(SettingsError, match="Set a token"):
        serve(
            ServeSettings(folder=tmp_path / "s", port=0, host="0.0.0.0", token=token), lambda _address: None
        )


def test_without_the_cookie_nothing_is_shown(own: Site) -> None:
    """Other users of the machine reach the port as well."""
    own.finished()
    paths = ("/", "/entries", "/events", f"/reports/{SHA}", f"/reports/{SHA}/page", "/static/serve.js")
    assert {own.ask(path, cookie=False).status for path in paths} == {401}


def test_a_wrong_cookie_is_none(own: Site) -> None:
    """Its value is made with a secret of the store."""
    assert own.ask("/", cookie=False, Cookie=f"{own.access.cookie_name}={'0' * 64}").status == 401


def test_the_start_address_gives_a_strict_cookie_that_no_script_reads(own: Site) -> None:
    """Scripts cannot read it, and no other site's request carries it."""
    answer = own.ask(f"/start?token={own.access.token}", cookie=False)
    cookie = answer.headers["set-cookie"].lower()
    assert answer.status == 200
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_the_token_may_be_typed(own: Site) -> None:
    """As on a machine that the address was not printed on."""
    answer = own.ask("/start", "POST", [f"token={own.access.token}".encode()], cookie=False)
    assert answer.status == 200
    assert own.access.cookie in answer.headers["set-cookie"]


def test_a_wrong_token_gives_no_cookie(own: Site) -> None:
    """However it is given."""
    asked = own.ask("/start?token=wrong", cookie=False)
    posted = own.ask("/start", "POST", [b"token=wrong"], cookie=False)
    assert [asked.status, posted.status] == [403, 403]
    assert "set-cookie" not in asked.headers.keys() | posted.headers.keys()


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        f"evil.example:{PORT}",
        "127.0.0.1",
        "127.0.0.1:80",
        f"127.0.0.1.evil.example:{PORT}",
        "",
    ],
)
def test_a_name_that_is_not_the_servers_is_refused(own: Site, host: str) -> None:
    """DNS rebinding: a page of evil.example whose name now leads to this machine; the port counts, too."""
    assert own.ask("/", host=host).status == 421


@pytest.mark.parametrize(
    "host", [f"127.0.0.1:{PORT}", f"localhost:{PORT}", f"[::1]:{PORT}", f"LOCALHOST:{PORT}"]
)
def test_the_servers_own_names_are_let_in(own: Site, host: str) -> None:
    """As browsers write them."""
    assert own.ask("/", host=host).status == 200


def test_a_server_for_all_addresses_takes_numbers_but_no_foreign_name(own: Site) -> None:
    """No name server has a say in a numerical address."""
    access = dataclasses.replace(own.access, any_address=True)
    assert access.is_ours(f"192.168.1.7:{PORT}")
    assert not access.is_ours(f"evil.example:{PORT}")
    assert not access.is_ours("192.168.1.7:80")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", f"http://evil.example:{PORT}", "http://127.0.0.1:80", "null", None]
)
def test_what_changes_something_must_come_from_our_page(own: Site, origin: str | None) -> None:
    """Another page's form, another port of this machine, a sandboxed frame, or no page at all."""
    own.finished()
    assert own.ask(f"/entries/{SHA}", "DELETE", origin=origin).status == 403
    assert own.schedule.get(SHA) is not None


@pytest.mark.parametrize("fetch_site", ["cross-site", "same-site", "none"])
def test_the_browsers_word_about_the_origin_counts_too(own: Site, fetch_site: str) -> None:
    """Whatever the header Origin says."""
    own.finished()
    assert own.ask(f"/entries/{SHA}", "DELETE", sec_fetch_site=fetch_site).status == 403


@pytest.mark.parametrize(
    ("mode", "dest"), [("no-cors", "image"), ("cors", "empty"), ("navigate", "iframe"), ("no-cors", "script")]
)
def test_other_sites_cannot_use_what_is_here(own: Site, mode: str, dest: str) -> None:
    """Neither as an image nor in a frame."""
    headers = {"sec_fetch_site": "cross-site", "sec_fetch_mode": mode, "sec_fetch_dest": dest}
    assert own.ask("/entries", **headers).status == 403


@pytest.mark.parametrize("fetch_site", ["same-site", "cross-site"])
@pytest.mark.parametrize("path", ["/", "/entries", f"/reports/{SHA}/page"])
def test_a_page_of_another_port_reads_nothing(own: Site, fetch_site: str, path: str) -> None:
    """Browsers give the cookie to every port of a host: a link there shows the page that takes the token."""
    own.finished()
    link = {"sec_fetch_site": fetch_site, "sec_fetch_mode": "navigate", "sec_fetch_dest": "document"}
    assert own.ask(path, **link).status == 401
    assert (
        own.ask(path, sec_fetch_site=fetch_site, sec_fetch_mode="cors", sec_fetch_dest="empty").status == 403
    )


@pytest.mark.parametrize("fetch_site", ["same-origin", "none", None])
def test_our_own_page_and_a_typed_address_read(own: Site, fetch_site: str | None) -> None:
    """A script, and an old browser, do not say where they come from."""
    assert own.ask("/entries", sec_fetch_site=fetch_site).status == 200


def test_an_old_browsers_request_for_another_page_reads_nothing(own: Site) -> None:
    """It says by ``Origin`` who asks."""
    assert own.ask("/entries", origin="http://127.0.0.1:80").status == 403
    assert own.ask("/entries", origin=OWN).status == 200


def test_a_link_on_another_site_may_lead_here(own: Site) -> None:
    """As one in a mail or a terminal in the browser."""
    headers = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate", "sec_fetch_dest": "document"}
    assert own.ask("/start?token=" + own.access.token, cookie=False, **headers).status == 200


@pytest.mark.parametrize("path", ["/", "/entries", "/nothing", f"/reports/{SHA}"])
def test_every_page_says_what_a_browser_may_do(own: Site, path: str) -> None:
    """Only our own files are loaded, nothing is sent elsewhere, nobody frames us, and no type is guessed."""
    own.finished()
    headers = own.ask(path).headers
    policy = headers["content-security-policy"]
    for part in ("default-src 'none'", "script-src 'self'", "connect-src 'self'", "frame-ancestors 'none'"):
        assert part in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"


def test_a_report_runs_without_our_origin(own: Site) -> None:
    """In a sandboxed frame, and in a sandbox of its own where somebody opens it alone."""
    own.finished()
    policy = own.ask(f"/reports/{SHA}/page").headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts;")
    assert "allow-same-origin" not in policy
    assert "default-src 'none'" in policy
    assert '<iframe sandbox="allow-scripts" ' in own.ask(f"/reports/{SHA}").text


def test_the_name_of_a_log_is_escaped(own: Site) -> None:
    """It comes from whoever named the file."""
    own.finished(name="<img src=x onerror=alert(1)>.bin")
    text = own.ask(f"/reports/{SHA}").text
    assert "<img" not in text
    assert "&lt;img" in text


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/etc/passwd", "..\\..\\boot.ini", "a\0b", "\u202egnp.exe"]
)
def test_a_logs_name_never_becomes_a_path(own: Site, name: str) -> None:
    """Files are named by their content's hash; of a name only the last part is shown, and visibly so."""
    answer = own.ask("/upload", "PUT", [b"some log"], x_log_name=quote(name))
    assert answer.status == 201
    assert [path.name for path in (own.store.folder / "logs").iterdir()] == [sha256(b"some log").hexdigest()]
    shown = next(iter(own.schedule.entries())).name
    assert not set(shown) & set("/\\\0\u202e")


@pytest.mark.parametrize(
    "path",
    [
        "/reports/../secret/page",
        f"/reports/{SHA}/files/../../../secret",
        f"/reports/{SHA}/files/%2e%2e",
        "/reports/..%2f..%2fsecret",
    ],
)
def test_an_address_reaches_no_file_but_results(own: Site, path: str) -> None:
    """Only what is listed is given."""
    own.finished()
    assert own.ask(path).status == 404


def test_an_upload_is_counted_whatever_it_declares(tmp_path: Path) -> None:
    """It is stopped at the block that is too much, and nothing of it stays."""
    with site(tmp_path / "store", max_bytes=1000) as own:
        answer = own.ask("/upload", "PUT", [b"x" * 400] * 100, content_length="10")
        assert answer.status == 413
        assert not list((own.store.folder / "uploads").iterdir())
        assert not list((own.store.folder / "logs").iterdir())


def test_a_declared_size_that_is_too_large_is_refused_before_anything_is_written(own: Site) -> None:
    """10 GB do not fill the disk first."""
    answer = own.ask("/upload", "PUT", [b"x" * 100], content_length="10000000000")
    assert answer.status == 413
    assert answer.headers["connection"] == "close"


def test_an_upload_leaves_room_on_the_disk(own: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """For results, and for everything else of this machine."""
    monkeypatch.setattr(own.store, "free_bytes", lambda: 500_000_050)
    assert own.ask("/upload", "PUT", [b"x" * 100], content_length="100").status == 507
    assert own.ask("/upload", "PUT", [b"x" * 40], content_length="40").status == 201


def test_uploads_leave_room_together(own: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each alone would fit."""
    monkeypatch.setattr(own.store, "free_bytes", lambda: 500_000_100)
    assert refused_beside(Uploads(own.store, 1000), n_running=1, declared=60) == 507


@pytest.mark.parametrize(("n_running", "status"), [(15, 0), (16, 503)])
def test_sixteen_uploads_go_at_a_time(own: Site, n_running: int, status: int) -> None:
    """A browser that opens more takes no worker from others."""
    assert refused_beside(Uploads(own.store, 1000), n_running=n_running, declared=1) == status


def refused_beside(uploads: Uploads, *, n_running: int, declared: int) -> int:
    """Return the status that one more upload is refused with beside running ones, 0 if it is taken."""

    async def waiting(until: asyncio.Event) -> AsyncIterator[bytes]:
        await until.wait()
        yield b"x"

    async def at_once() -> int:
        until, now = asyncio.Event(), asyncio.Event()
        now.set()
        running = [asyncio.create_task(uploads.take(waiting(until), declared)) for _ in range(n_running)]
        await asyncio.sleep(0.0)
        try:
            await uploads.take(waiting(now), declared)
            status = 0
        except UploadError as error:
            status = error.status
        until.set()
        await asyncio.gather(*running)
        return status

    return asyncio.run(at_once())


def test_long_questions_are_not_read(own: Site) -> None:
    """A form is no way around the limit of uploads."""
    assert own.ask("/compare", "POST", [b"[" * 6000] * 4).status == 413


@pytest.mark.parametrize("body", [b"[" * 9000, b"\xff", b'"text"', b'{"before": {"a": 1}, "after": []}'])
def test_a_question_that_is_none_is_refused(own: Site, body: bytes) -> None:
    """Nesting, no text, no object, no ids."""
    assert own.ask("/compare", "POST", [body]).status == 400


def open_to_others(folder: Path) -> list[Path]:
    """Return what other users could read."""
    return [path for path in (folder, *folder.rglob("*")) if path.stat().st_mode & 0o077]


def test_other_users_cannot_read_the_store(own: Site) -> None:
    """Logs tell where somebody flies: neither the log nor its result, nor the queue."""
    own.finished()
    answer = own.ask("/upload", "PUT", [b"a log"])
    assert answer.status == 201
    assert open_to_others(own.store.folder) == []


def test_a_store_that_others_could_read_is_closed_to_them(tmp_path: Path) -> None:
    """Earlier versions left all files readable."""
    with site(tmp_path / "store") as own:
        own.finished()
    for path in (tmp_path / "store").rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    with site(tmp_path / "store") as own:
        assert open_to_others(own.store.folder) == []
        assert (own.store.log(SHA).stat().st_mode & 0o777, own.store.folder.stat().st_mode & 0o777) == (
            0o600,
            0o700,
        )


def test_the_cookie_outlives_the_server_but_not_a_changed_token(own: Site) -> None:
    """An open page goes on after a restart; whoever knew the old token of an open server does not."""
    same = dataclasses.replace(own.access, token="another start")
    changed = dataclasses.replace(own.access, salt="another chosen token")
    assert same.cookie == own.access.cookie
    assert changed.cookie != own.access.cookie


def test_no_name_of_a_host_leaves_the_machine_to_be_looked_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even the machine's own name is asked of a name server."""

    def refuse(*_arguments: object, **_options: object) -> None:
        raise AssertionError("a name was looked up")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    with site(tmp_path / "store") as own:
        own.schedule.submit(log_entry(SHA, "a.bin", 1, -1.0))
        assert own.ask("/", origin=OWN).status == 200
