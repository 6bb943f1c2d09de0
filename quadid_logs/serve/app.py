"""The routes; nothing of an address or a name from outside ever becomes a path."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import parse_qs, unquote

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route

from quadid_logs.counting import counted
from quadid_logs.serve.entries import Entry, Kind, State, earlier_of, is_id, log_entry, question
from quadid_logs.serve.events import Pages, changes_dict
from quadid_logs.serve.jobs import PAGE_FILE
from quadid_logs.serve.lingering import Lingering
from quadid_logs.serve.pages import page, start_page, static_files, vehicle_page
from quadid_logs.serve.schedule import Schedule
from quadid_logs.serve.security import REPORT_POLICY, Access, Guard
from quadid_logs.serve.store import ServeStore
from quadid_logs.serve.upload import UploadError, Uploads
from quadid_logs.untrusted import printable
from quadid_logs.vocabulary import AXES

#: Of a form or a question [bytes].
_MOST_BODY: Final = 10_000
#: It comes at once, or never [s].
_BODY_S: Final = 10.0
#: A wrong token costs its sender so long [s].
_WRONG_TOKEN_S: Final = 0.5
#: A plan's form: longest text.
_MOST_TEXT: Final = 40
#: Of a vehicle's name.
_MOST_NAME: Final = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Server:
    """What the routes share."""

    store: ServeStore
    schedule: Schedule
    access: Access
    pages: Pages
    max_bytes: int


def make_app(server: Server) -> Lingering:
    """Return the ASGI application.

    Around the guard, and that around the routes.
    """
    routes = _Routes(server)
    app = Starlette(
        routes=[
            Route("/", routes.home),
            Route("/start", routes.start, methods=["GET", "POST"]),
            Route("/static/{name}", routes.static),
            Route("/events", routes.events),
            Route("/entries", routes.entries),
            Route("/upload", routes.upload, methods=["PUT"]),
            Route("/compare", routes.compare, methods=["POST"]),
            Route("/tune", routes.tune, methods=["POST"]),
            Route("/plan", routes.plan, methods=["POST"]),
            Route("/entries/{id}/cancel", routes.cancel, methods=["POST"]),
            Route("/entries/{id}/again", routes.again, methods=["POST"]),
            Route("/entries/{id}/log", routes.choose, methods=["POST"]),
            Route("/entries/{id}", routes.delete, methods=["DELETE"]),
            Route("/vehicles/{id}", routes.vehicle),
            Route("/vehicles/{id}/name", routes.rename, methods=["POST"]),
            Route("/reports/{id}", routes.report),
            Route("/reports/{id}/page", routes.report_page),
            Route("/reports/{id}/files/{name}", routes.file),
        ],
    )
    return Lingering(Guard(app, server.access))


class _Routes:
    """One method per route."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._schedule = server.schedule
        self._uploads = Uploads(server.store, server.max_bytes)

    async def home(self, request: Request) -> Response:  # noqa: ARG002 - Starlette gives it
        """Show the list."""
        from quadid_logs.diagnose.advice import plannable

        return page("home.html", max_bytes=self._server.max_bytes, axes=AXES, autopilots=plannable())

    async def start(self, request: Request) -> Response:
        """Take the token, and give the cookie for it."""
        token = request.query_params.get("token", "")
        if request.method == "POST":
            token = parse_qs((await _body(request)).decode("utf-8", "replace")).get("token", [""])[0]
        elif not token:
            return start_page("")
        access = self._server.access
        if not access.knows_token(token):
            await asyncio.sleep(_WRONG_TOKEN_S)
            return start_page("This is not the token of this server.", status=403)
        # No redirect: after one that began on another page (a terminal's, say) a strict cookie is not sent.
        response = page("enter.html")
        response.set_cookie(access.cookie_name, access.cookie, httponly=True, samesite="strict", path="/")
        return response

    async def static(self, request: Request) -> Response:
        """Give the stylesheet or the script."""
        found = static_files().get(request.path_params["name"])
        if found is None:
            raise HTTPException(404)
        return Response(found[1], media_type=found[0])

    async def events(self, request: Request) -> Response:  # noqa: ARG002 - Starlette gives it
        """Tell a page what changes."""
        return StreamingResponse(self._server.pages.events(self._schedule), media_type="text/event-stream")

    async def entries(self, request: Request) -> Response:  # noqa: ARG002 - Starlette gives it
        """Give the whole list at once, for scripts."""
        return JSONResponse(changes_dict(self._schedule.changes(0), is_all=True))

    async def upload(self, request: Request) -> Response:
        """Take a log: the body is the file, its name and date are headers."""
        declared = request.headers.get("content-length", "")
        try:
            taken = await self._uploads.take(_blocks(request), int(declared) if declared.isdigit() else None)
        except UploadError as error:
            # What is still being sent is not kept.
            headers = {"Connection": "close"} | ({"Retry-After": "10"} if error.status == 503 else {})
            return JSONResponse({"error": str(error)}, error.status, headers)
        name = unquote(request.headers.get("x-log-name", "log"))
        entry = log_entry(taken.sha256, name, taken.n_bytes, _date(request.headers.get("x-log-modified", "")))
        held = await asyncio.to_thread(self._schedule.submit, entry)
        return JSONResponse(held.shown(), 201 if held is entry else 200)

    async def compare(self, request: Request) -> Response:
        """Queue a comparison of two logs, in the order given."""
        given = await _json(request)
        logs = tuple(self._log(str(given.get(which, ""))) for which in ("before", "after"))
        if logs[0].id == logs[1].id:
            raise HTTPException(400, "Choose two different flights.")
        name = " → ".join(log.name for log in logs)
        return await self._ask(question(Kind.COMPARE, name, tuple(log.id for log in logs)), logs)

    async def tune(self, request: Request) -> Response:
        """Queue the question for the next gains to fly, with what earlier flights of the vehicle tell."""
        log = self._log(str((await _json(request)).get("log", "")))
        earlier = earlier_of(log, self._schedule.entries())
        asked = f" and {counted(len(earlier), 'earlier flight')}" if earlier else ""
        ids = tuple(one.id for one in (log, *earlier))
        return await self._ask(question(Kind.TUNE, f"Next gains: {log.name}{asked}", ids), (log, *earlier))

    async def plan(self, request: Request) -> Response:
        """Queue a plan of a flight."""
        given = await _json(request)
        wanted = given.get("axes")
        axes = [axis for axis in AXES if isinstance(wanted, list) and axis in wanted] or list(AXES)
        options = {
            "autopilot": str(given.get("autopilot", ""))[:_MOST_TEXT],
            "firmware": str(given.get("firmware", ""))[:_MOST_TEXT].strip(),
            "axes": axes,
        }
        autopilot = f"{options['autopilot']} {options['firmware']}".strip()
        name = f"Flight plan: {', '.join(axes)} ({autopilot})"
        return await self._ask(question(Kind.PLAN, name, (), options), ())

    async def cancel(self, request: Request) -> Response:
        """Let a job be."""
        await asyncio.to_thread(self._schedule.cancel, self._entry(request).id)
        return Response(status_code=204)

    async def again(self, request: Request) -> Response:
        """Do a job once more."""
        await asyncio.to_thread(self._schedule.again, self._entry(request).id)
        return Response(status_code=204)

    async def choose(self, request: Request) -> Response:
        """Analyze another log of a file that holds several."""
        number = (await _json(request)).get("number")
        entry = self._entry(request)
        if not isinstance(number, int) or not await asyncio.to_thread(
            self._schedule.choose, entry.id, number
        ):
            raise HTTPException(400, "The file holds no such log.")
        return Response(status_code=204)

    async def delete(self, request: Request) -> Response:
        """Delete an entry and all that is known of it."""
        await asyncio.to_thread(self._schedule.forget, self._entry(request).id)
        return Response(status_code=204)

    async def vehicle(self, request: Request) -> Response:
        """Show the history of the vehicle that flew a log."""
        name = str(self._done(request).summary.get("vehicle", ""))
        found = await asyncio.to_thread(vehicle_page, self._server.store.history, name)
        if found is None:
            raise HTTPException(404, "No flight of this vehicle was analyzed yet.")
        return found

    async def rename(self, request: Request) -> Response:
        """Call the vehicle that flew a log as its owner does."""
        entry = self._done(request)
        name = printable(str((await _json(request)).get("name", "")), _MOST_NAME).strip()
        if not name:
            raise HTTPException(400, "Give the vehicle a name.")
        await asyncio.to_thread(self._schedule.rename, entry.id, name)
        return Response(status_code=204)

    async def report(self, request: Request) -> Response:
        """Show a result inside our page, with its files."""
        entry = self._done(request)
        files = sorted(path.name for path in self._server.store.result(entry.id).iterdir())
        return page("report_frame.html", entry=entry, files=files, page_file=PAGE_FILE)

    async def report_page(self, request: Request) -> Response:
        """Give a result's own page, which runs without our origin."""
        entry = self._done(request)
        content = await asyncio.to_thread((self._server.store.result(entry.id) / PAGE_FILE).read_bytes)
        headers = {"Content-Security-Policy": REPORT_POLICY, "Cross-Origin-Opener-Policy": "unsafe-none"}
        return HTMLResponse(content, headers=headers)

    async def file(self, request: Request) -> Response:
        """Give a file of a result to keep: one that is there, not what an address says."""
        entry = self._done(request)
        listed = {path.name: path for path in self._server.store.result(entry.id).iterdir()}
        path = listed.get(request.path_params["name"])
        if path is None:
            raise HTTPException(404)
        stem = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in entry.name)
        return FileResponse(path, media_type="application/octet-stream", filename=f"{stem[:80]}.{path.name}")

    async def _ask(self, entry: Entry, logs: tuple[Entry, ...]) -> Response:
        """Queue a question, or return what is known of it."""
        from dataclasses import replace

        sized = replace(entry, n_bytes=sum(log.n_bytes for log in logs))
        held = await asyncio.to_thread(self._schedule.submit, sized)
        return JSONResponse(held.shown(), 201)

    def _entry(self, request: Request) -> Entry:
        """Return the entry that an address names."""
        entry = self._schedule.get(request.path_params["id"])
        if entry is None or not is_id(entry.id):
            raise HTTPException(404, "There is no such entry.")
        return entry

    def _done(self, request: Request) -> Entry:
        """Return the entry that an address names, if there is a result."""
        entry = self._entry(request)
        if entry.state is not State.DONE:
            raise HTTPException(404, "There is no result yet.")
        return entry

    def _log(self, entry_id: str) -> Entry:
        """Return a log that was analyzed."""
        entry = self._schedule.get(entry_id)
        if entry is None or entry.kind is not Kind.ANALYZE or entry.state is not State.DONE:
            raise HTTPException(400, "Choose flights that were analyzed.")
        return entry


async def _blocks(request: Request) -> AsyncIterator[bytes]:
    """Yield the parts of a body as they come."""
    async for block in request.stream():
        if block:
            yield block


async def _body(request: Request) -> bytes:
    """Return a small body."""
    found = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for block in request.stream():
                found += block
                if len(found) > _MOST_BODY:
                    raise HTTPException(413, "The request is too long.")
    except TimeoutError as error:
        raise HTTPException(408, "The request was cut off.") from error
    return found


async def _json(request: Request) -> Mapping[str, Any]:
    """Return what a question says."""
    try:
        found = json.loads(await _body(request))
    except (ValueError, RecursionError) as error:
        raise HTTPException(400, "The request is not JSON.") from error
    if not isinstance(found, dict):
        raise HTTPException(400, "The request is not valid.")
    return found


def _date(text: str) -> float:
    """Return when a file was modified [s UTC], -1 if the browser does not say."""
    with contextlib.suppress(ValueError):
        milliseconds = float(text)
        if math.isfinite(milliseconds) and 0.0 < milliseconds < 4e12:
            return milliseconds / 1000.0
    return -1.0
