// The local page: uploads, the queue, the flights. Texts of logs become text nodes, never markup.
"use strict";
(() => {
  const AT_ONCE = 2, RETRY_MS = 1500, MOST_TRIES = 5;
  const byId = (id) => document.getElementById(id);
  const main = document.querySelector("main");
  if (!byId("drop")) return;
  const maxBytes = Number(main.dataset.maxBytes), axes = main.dataset.axes.split(" ");
  const entries = new Map(), marked = new Set(), spoken = new Set();
  let running = {}, uploads = [], nextUpload = 0, first = true;

  // --- making elements

  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (value === true) element.setAttribute(name, "");
      else if (value !== false && value !== null) element.setAttribute(name, value);
    }
    element.append(...children.filter((child) => child !== null));
    return element;
  };
  const button = (text, label, action, kind = "") =>
    make("button", { type: "button", class: kind, "aria-label": label, onclick: action }, text);
  const span = (seconds) =>
    seconds < 1 ? "nearly done" : seconds < 100 ? `about ${Math.round(seconds)} s left` : `about ${Math.round(seconds / 60)} min left`;
  const size = (bytes) => (bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / 1e6).toFixed(1)} MB`);
  const say = (text) => { byId("said").textContent = text; };

  // --- asking the server

  const ask = async (method, path, body) => {
    try {
      const answer = await fetch(path, {
        method,
        headers: body ? { "Content-Type": "application/json" } : {},
        body: body ? JSON.stringify(body) : undefined,
      });
      if (!answer.ok) say(`Refused: ${(await answer.text()).slice(0, 300)}`);
      return answer.ok ? answer : null;
    } catch {
      say("The server does not answer.");
      return null;
    }
  };

  // A question whose answer is there leads to it; another one goes into the queue.
  const pose = async (path, question) => {
    const answer = await ask("POST", path, question);
    if (!answer) return false;
    const entry = await answer.json();
    take(entry);
    if (entry.state === "done") location.href = `/reports/${entry.id}`;
    else say(`${entry.name}: in the queue`);
    return true;
  };

  // --- uploads: what could not be sent is sent again when the server is back

  const add = (files) => {
    for (const file of files) {
      const upload = { key: `upload-${nextUpload++}`, file, state: "waiting", sent: 0, tries: 0, error: "" };
      if (file.size > maxBytes) Object.assign(upload, { state: "failed", error: `It is larger than this server accepts (${size(maxBytes)}).` });
      if (file.size === 0) Object.assign(upload, { state: "failed", error: "The file is empty, or a folder." });
      uploads.push(upload);
    }
    pump();
    drawQueue();
  };

  const pump = () => {
    const sending = uploads.filter((upload) => upload.state === "sending").length;
    for (const upload of uploads.filter((each) => each.state === "waiting").slice(0, AT_ONCE - sending)) send(upload);
  };

  const send = (upload) => {
    const request = new XMLHttpRequest();
    Object.assign(upload, { state: "sending", request });
    request.open("PUT", "/upload");
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.setRequestHeader("X-Log-Name", encodeURIComponent(upload.file.name).slice(0, 2000).replace(/%.?$/, ""));
    request.setRequestHeader("X-Log-Modified", String(upload.file.lastModified));
    request.upload.onprogress = (event) => { upload.sent = event.loaded / Math.max(event.total, 1); tick(); };
    const end = (state, error = "") => {
      Object.assign(upload, { state, error });
      if (state === "taken") uploads = uploads.filter((each) => each !== upload);
      pump();
      drawQueue();
    };
    request.onload = () => {
      if (request.status < 300) {
        take(JSON.parse(request.responseText));
        end("taken");
      } else if (request.status === 503) retry();
      else {
        let reason = request.responseText;
        try { reason = JSON.parse(reason).error; } catch { /* plain text */ }
        end("failed", reason.slice(0, 300));
      }
    };
    const retry = () => {
      // A server that is gone is waited for; one that is there and breaks off again and again means it.
      if (byId("connection").hidden && ++upload.tries > MOST_TRIES) {
        end("failed", "The server ended the upload. Its disk may be nearly full.");
        return;
      }
      Object.assign(upload, { state: "pausing", sent: 0 });
      drawQueue();
      setTimeout(() => { if (uploads.includes(upload)) end("waiting"); }, RETRY_MS);
    };
    request.onerror = retry;
    request.onabort = () => { uploads = uploads.filter((each) => each !== upload); pump(); drawQueue(); };
    request.send(upload.file);
  };

  const drop = (upload) => {
    if (upload.state === "sending") upload.request.abort();
    else { uploads = uploads.filter((each) => each !== upload); drawQueue(); }
  };

  // --- what is known

  // What an answer says may be older than what the events have told meanwhile.
  const take = (entry) => { if (!entries.has(entry.id)) entries.set(entry.id, entry); draw(); };

  const learn = (news) => {
    if (news.all) entries.clear();
    for (const entry of news.entries) entries.set(entry.id, entry);
    for (const id of news.gone) { entries.delete(id); marked.delete(id); }
    running = news.running;
    const left = news.waiting || Object.keys(running).length;
    byId("queue-left").textContent = left
      ? `${Object.keys(running).length} running, ${news.waiting} waiting, ${span(news.left_s)}` : "";
    if (news.entries.length || news.gone.length || news.all) { announce(news.entries); draw(); }
    tick();
  };

  const announce = (fresh) => {
    for (const entry of fresh) {
      const final = entry.state === "done" || entry.state === "failed";
      if (!final) { spoken.delete(entry.id); continue; }
      if (!first && !spoken.has(entry.id)) say(`${entry.name}: ${entry.summary.headline || entry.error || "done"}`);
      spoken.add(entry.id);
    }
    first = false;
  };

  // --- the queue

  const isOpen = (entry) => entry.state === "queued" || entry.state === "running";
  const gaveNothing = (entry) => entry.state === "failed" || entry.state === "cancelled";
  const draw = () => { drawQueue(); drawFlights(); drawAnswers(); };

  const drawQueue = () => {
    const open = [...entries.values()].filter(isOpen);
    keep(byId("queue-list"), [
      ...uploads.map((upload) => [upload.key, `${upload.state} ${upload.error}`, () => uploadLine(upload)]),
      ...open.map((entry) => [entry.id, `${entry.state} ${entry.error} ${Boolean(entry.summary.headline)}`, () => entryLine(entry)]),
    ]);
    byId("queue").hidden = !open.length && !uploads.length;
    const failed = [...entries.values()].filter(gaveNothing);
    keep(byId("failed-list"), failed.map((entry) => [entry.id, `${entry.state} ${entry.error}`, () => entryLine(entry)]));
    byId("failed").hidden = !failed.length;
  };

  // Lines stay the same elements as long as nothing but progress changes: the focus stays where it is.
  const keep = (list, wanted) => {
    const held = new Map([...list.children].map((line) => [line.dataset.key, line]));
    let place = list.firstElementChild;
    for (const [key, kind, draft] of wanted) {
      let line = held.get(key);
      if (!line || line.dataset.kind !== kind) {
        const fresh = draft();
        fresh.dataset.key = key;
        fresh.dataset.kind = kind;
        if (line) { if (place === line) place = fresh; line.replaceWith(fresh); } else list.insertBefore(fresh, place);
        line = fresh;
      }
      held.delete(key);
      if (line === place) place = place.nextElementSibling;
      else if (line.nextElementSibling !== place) list.insertBefore(line, place);
    }
    for (const line of held.values()) line.remove();
  };

  const uploadLine = (upload) => {
    const name = upload.file.name;
    const words = { waiting: "waiting to be sent", sending: "sending", pausing: "the server does not answer; trying again", failed: upload.error }[upload.state];
    const failed = upload.state === "failed";
    return make("li", { class: failed ? "error" : "" },
      make("div", { class: "what" }, make("strong", {}, name), make("small", { class: "stage" }, words),
        failed ? null : make("progress", { max: 1, value: upload.sent, "aria-label": `Sending ${name}` })),
      button(failed ? "Dismiss" : "Cancel", `${failed ? "Dismiss" : "Cancel"} ${name}`, () => drop(upload)));
  };

  const entryLine = (entry) => {
    const actions = entry.state === "queued" || entry.state === "running"
      ? [button("Cancel", `Cancel ${entry.name}`, () => ask("POST", `/entries/${entry.id}/cancel`))]
      : [button("Try again", `Try again ${entry.name}`, () => ask("POST", `/entries/${entry.id}/again`)), deleter(entry)];
    const words = { queued: "waiting", running: "", failed: entry.error, cancelled: "cancelled" }[entry.state];
    return make("li", { class: entry.state === "failed" ? "error" : "" },
      make("div", { class: "what" },
        make("strong", {}, entry.name),
        entry.state === "failed" ? make("span", { class: "badge" }, "no result") : null,
        entry.summary.headline ? make("div", {}, entry.summary.headline) : null,
        make("small", { class: "stage" }, words),
        entry.state === "running" ? make("progress", { max: 1, value: 0, "aria-label": `Progress of ${entry.name}` }) : null),
      make("div", { class: "actions" }, ...actions));
  };

  const tick = () => {
    for (const line of byId("queue-list").children) {
      const job = running[line.dataset.key];
      const upload = uploads.find((each) => each.key === line.dataset.key);
      const bar = line.querySelector("progress");
      if (!bar) continue;
      bar.value = job ? job.fraction : upload ? upload.sent : 0;
      if (job) line.querySelector(".stage").textContent = `${job.stage || "beginning"}, ${span(job.left_s)}`;
    }
  };

  const deleter = (entry) => button("Delete", `Delete ${entry.name}`, () => confirmDelete(entry), "danger");

  const confirmDelete = (entry) => {
    const dialog = byId("confirm");
    byId("confirm-text").textContent = entry.kind === "analyze"
      ? `${entry.name}: the log's copy on this server, its report, its comparisons and its place in the vehicle's history will be deleted. The file on your disk or card stays.`
      : `${entry.name} is deleted.`;
    dialog.returnValue = "no";
    dialog.onclose = () => { if (dialog.returnValue === "yes") ask("DELETE", `/entries/${entry.id}`); };
    dialog.showModal();
  };

  // --- flights by vehicle

  const flown = (entry) => entry.summary.started || new Date(entry.added_s * 1000).toISOString();
  const date = (entry) => {
    const { started, started_from: from } = entry.summary;
    if (!started) return "date unknown";
    const when = started.slice(0, 16).replace("T", " ");
    return from === "modification" ? `file of ${when}` : when;
  };

  const drawFlights = () => {
    const done = [...entries.values()].filter((entry) => entry.kind === "analyze" && entry.state === "done");
    byId("no-flights").hidden = done.length > 0;
    byId("flight-actions").hidden = done.length < 2;
    const vehicles = new Map();
    for (const entry of done) {
      if (!vehicles.has(entry.summary.vehicle)) vehicles.set(entry.summary.vehicle, []);
      vehicles.get(entry.summary.vehicle).push(entry);
    }
    const names = [...vehicles.keys()].sort();
    keep(byId("vehicles"), names.map((name) => {
      const flights = vehicles.get(name).sort((a, b) => flown(b).localeCompare(flown(a)));
      return [name, flights.map((entry) => `${entry.id} ${entry.name} ${entry.summary.log} ${gainsOf(entry)?.state} ${checkOf(entry, flights)?.state}`).join(), () => vehicleTable(name, flights)];
    }));
    markable();
  };

  const vehicleTable = (name, flights) =>
    make("div", {},
      make("h3", {}, name),
      make("p", { class: "quiet" }, [flights[0].summary.craft, flights[0].summary.model].filter(Boolean).join(", "), " · ",
        make("a", { href: `/vehicles/${flights[0].id}` }, `history of ${flights.length} log${flights.length === 1 ? "" : "s"}`), " · ",
        button("Rename", `Rename ${name}`, () => rename(name, flights[0].id))),
      make("table", { class: "flights" },
        make("thead", {}, make("tr", {}, ...["compare", "log", ...axes, "actions"].map((head) =>
          make("th", { scope: "col" }, head)))),
        make("tbody", {}, ...flights.map((entry) => flightRow(entry, flights)))));

  const rename = (name, id) => {
    const wanted = window.prompt(`What do you call ${name}? Its logs, and later ones of the same vehicle, get that name.`, name);
    if (wanted && wanted.trim() && wanted !== name) ask("POST", `/vehicles/${id}/name`, { name: wanted });
  };

  const flightRow = (entry, flights) =>
    make("tr", {},
      make("td", { "data-head": "compare" }, make("input", {
        type: "checkbox", "aria-label": `Compare ${entry.name}`, checked: marked.has(entry.id), "data-mark": entry.id, onchange: mark,
      })),
      make("th", { scope: "row" }, make("a", { href: `/reports/${entry.id}` }, entry.name),
        make("small", {}, `${date(entry)}; ${entry.summary.flown}; ${size(entry.n_bytes)}`), chooser(entry)),
      ...axes.map((axis) => {
        const found = (entry.summary.axes || {})[axis] || { verdict: "refused", effect: "" };
        return make("td", { class: found.verdict, "data-head": axis },
          make("span", { class: "badge" }, found.verdict), found.effect ? make("small", {}, found.effect) : null);
      }),
      make("td", {}, make("div", { class: "actions" },
        gains(entry), check(entry, flights), deleter(entry))));

  // A file may hold several logs; another choice is analyzed in place of the first.
  const chooser = (entry) => {
    const lengths = Object.entries(entry.summary.lengths_s || {});
    if (lengths.length < 2) return null;
    const choose = (event) => ask("POST", `/entries/${entry.id}/log`, { number: Number(event.target.value) });
    return make("select", { "aria-label": `Log of ${entry.name}`, onchange: choose },
      ...lengths.map(([number, length]) => make("option", { value: number, selected: Number(number) === entry.summary.log },
        `log ${number}, ${length < 10 ? length.toFixed(1) : Math.round(length)} s`)));
  };

  // The gains stand in the row of their log: a button, then a link to the answer.
  const gainsOf = (entry) => [...entries.values()].find((each) => each.kind === "tune" && each.logs[0] === entry.id);
  const gains = (entry) => {
    const answer = gainsOf(entry);
    if (answer?.state === "done") return make("a", { href: `/reports/${answer.id}`, "aria-label": answer.name }, "Next gains");
    if (answer?.state === "queued" || answer?.state === "running") return make("span", { class: "quiet" }, "computing gains");
    return button("Next gains", `Next gains after ${entry.name}`, () => pose("/tune", { log: entry.id }));
  };

  // Against the flight before, whose next gains flew here if they were loaded.
  const beforeOf = (entry, flights) => flights[flights.indexOf(entry) + 1];
  const checkOf = (entry, flights) => [...entries.values()].find((each) =>
    each.kind === "compare" && each.logs[0] === beforeOf(entry, flights)?.id && each.logs[1] === entry.id);
  const check = (entry, flights) => {
    const before = beforeOf(entry, flights), answer = checkOf(entry, flights);
    if (!before) return null;
    const words = gainsOf(before)?.state === "done" ? "Promise kept?" : "Compare with last";
    if (answer?.state === "done") return make("a", { href: `/reports/${answer.id}`, "aria-label": answer.name }, words);
    if (answer?.state === "queued" || answer?.state === "running") return make("span", { class: "quiet" }, "comparing");
    return button(words, `${words} ${entry.name} after ${before.name}`, () => pose("/compare", { before: before.id, after: entry.id }));
  };

  const mark = (event) => {
    const { mark: id } = event.target.dataset;
    if (event.target.checked) marked.add(id); else marked.delete(id);
    markable();
  };

  const markable = () => {
    byId("compare").disabled = marked.size !== 2;
    for (const box of document.querySelectorAll("[data-mark]")) box.disabled = marked.size >= 2 && !box.checked;
  };

  byId("compare").addEventListener("click", async () => {
    const [before, after] = [...marked].map((id) => entries.get(id)).sort((a, b) => flown(a).localeCompare(flown(b)));
    if (!(await pose("/compare", { before: before.id, after: after.id }))) return;
    for (const box of document.querySelectorAll("[data-mark]")) box.checked = false;
    marked.clear();
    markable();
  });

  // --- comparisons and plans

  const drawAnswers = () => {
    const done = [...entries.values()].filter((entry) => entry.kind !== "analyze" && entry.state === "done");
    keep(byId("answer-list"), done.map((entry) => [entry.id, entry.name, () => make("li", {},
      make("div", { class: "what" }, make("a", { href: `/reports/${entry.id}` }, entry.name),
        make("small", {}, entry.summary.headline || "")),
      make("div", { class: "actions" }, deleter(entry)))]));
    byId("answers").hidden = !done.length;
  };

  byId("plan-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    await pose("/plan", { autopilot: form.get("autopilot"), firmware: form.get("firmware"), axes: form.getAll("axes") });
  });

  // --- dropping, choosing, leaving

  byId("files").addEventListener("change", (event) => { add([...event.target.files]); event.target.value = ""; });
  const over = (event, on) => {
    if (![...(event.dataTransfer?.types || [])].includes("Files")) return;
    event.preventDefault();
    byId("drop").classList.toggle("over", on);
  };
  addEventListener("dragover", (event) => over(event, true));
  addEventListener("dragleave", (event) => over(event, false));
  addEventListener("drop", (event) => { over(event, false); if (event.dataTransfer) add([...event.dataTransfer.files]); });
  addEventListener("beforeunload", (event) => {
    if (uploads.some((upload) => upload.state !== "failed")) event.preventDefault();
  });

  const events = () => {
    const source = new EventSource("/events");
    source.onmessage = (event) => { byId("connection").hidden = true; learn(JSON.parse(event.data)); };
    source.onerror = () => {
      byId("connection").hidden = false;
      source.close();
      setTimeout(events, RETRY_MS);
    };
  };
  events();
})();
