
"use strict";
(() => {
  const palettes = JSON.parse(document.getElementById("palettes").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const narrow = matchMedia("(max-width: 640px)");
  const charts = [...document.querySelectorAll(".chart")];
  const drawn = new Map();
  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  let printing = false;
  let shared = null;  // the range of time that all charts show, null for everything
  let spreading = false;

  // "@role" stands for the colour of that role on the present background.
  const coloured = (value, palette) => {
    if (typeof value === "string" && value[0] === "@") return palette[value.slice(1)] || value;
    if (ArrayBuffer.isView(value)) return value;
    if (Array.isArray(value)) return value.map((item) => coloured(item, palette));
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item, palette)]));
    return value;
  };

  // Of a line over time, no more is drawn than a screen has columns for; paper shows less, and every point
  // costs some 50 bytes of PDF.
  const mostPoints = { lines: 1600, markers: 900 };
  const mostOnScreen = 4000;

  const typed = { i2: Int16Array, f4: Float32Array, f8: Float64Array };
  const decoded = ({ dtype, bdata, low, step }) => {
    const bytes = Uint8Array.from(atob(bdata), (letter) => letter.charCodeAt(0));
    const values = new typed[dtype](bytes.buffer);
    return dtype === "i2" ? Float64Array.from(values, (value) => (value === -32768 ? NaN : low + (value + 32767) * step)) : values;
  };

  // Lines keep the lowest and the highest value and the first gap of each block of points, clouds every n-th point.
  const thinned = (x, y, lines, most) => {
    const size = Math.ceil((lines ? 2 : 1) * x.length / most);
    if (size < 2) return [x, y];
    const kept = [];
    for (let from = 0; from < x.length; from += size) {
      let low = from, high = from, gap = -1;
      for (let at = from; lines && at < Math.min(from + size, x.length); at++) {
        if (Number.isNaN(y[at])) gap = gap < 0 ? at : gap;
        else {
          if (!(y[at] >= y[low])) low = at;
          if (!(y[at] <= y[high])) high = at;
        }
      }
      kept.push(...new Set([low, high, ...(gap < 0 ? [] : [gap])].sort((a, b) => a - b)));
    }
    return [kept.map((at) => x[at]), kept.map((at) => y[at])];
  };

  // What is drawn of a line over time: the part in view, and the ends of the rest so that axes know how long it is.
  const inView = (trace) => {
    const { x, y } = trace;
    if (!shared) return thinned(x, y, true, mostOnScreen);
    let from = x.findIndex((value) => value >= shared[0]), to = x.findLastIndex((value) => value <= shared[1]);
    if (from < 0 || to < from) return thinned(x, y, true, mostOnScreen);
    from = Math.max(0, from - 1);
    to = Math.min(x.length, to + 2);
    const near = thinned(x.slice(from, to), y.slice(from, to), true, mostOnScreen);
    return [[x[0], ...near[0], x[x.length - 1]], [NaN, ...near[1], NaN]];
  };

  const isSeries = (figure, trace) => figure.over_time && trace.meta?.samples && trace.x.length > mostOnScreen;

  const forScreen = (figure) => figure.data.map((trace) => {
    if (!isSeries(figure, trace)) return trace;
    const [x, y] = inView(trace);
    return { ...trace, x, y };
  });

  // Say how much of the log is to be seen, where that is not all of it.
  const sayDetail = (chart, figure) => {
    const place = chart.parentElement.querySelector(".detail");
    const series = figure.data.find((trace) => trace.meta?.samples);
    if (!place || !series) return;
    const x = series.x, span = x[x.length - 1] - x[0];
    const seen = shared ? Math.min(1, (shared[1] - shared[0]) / span) : 1;
    const drawnPoints = isSeries(figure, series) ? inView(series)[0].length : x.length * seen;
    const every = Math.round(series.meta.samples * seen / drawnPoints);
    const finer = isSeries(figure, series) && x.length * seen > mostOnScreen;
    place.textContent = every < 2 ? "" : `1 of ${every} samples shown, peaks kept` + (finer ? "; zoom in to see more." : ".");
  };

  const seriesOf = (chart) => {
    const figure = drawn.get(chart);
    return figure.data.map((trace, place) => (isSeries(figure, trace) ? place : -1)).filter((place) => place >= 0);
  };

  // Show a range of time, null for all of it, as finely as it can be seen: one drawing of the chart, not two.
  const zoom = (chart, range) => {
    const figure = drawn.get(chart), places = seriesOf(chart);
    sayDetail(chart, figure);
    const axis = range ? { "xaxis.range": [...range] } : { "xaxis.autorange": true };
    if (!places.length) return Plotly.relayout(chart, axis);
    const views = places.map((place) => inView(figure.data[place]));
    return Plotly.update(chart, { x: views.map((view) => view[0]), y: views.map((view) => view[1]) }, axis, places);
  };

  // A PDF keeps each see-through point as a picture of its own: the same page takes six times the bytes.
  const forPaper = (trace) => {
    if (trace.fill || trace.z || trace.x.length < 3) return trace;
    const lines = trace.mode === "lines", [x, y] = thinned(trace.x, trace.y, lines, mostPoints[trace.mode]);
    return { ...trace, x, y, ...(trace.marker ? { marker: { ...trace.marker, opacity: 1 } } : {}) };
  };

  // Arrays that several traces have in common stand once in the page.
  const parsed = (chart) => {
    const figure = JSON.parse(document.getElementById("data-" + chart.dataset.key).textContent);
    const arrays = figure.arrays.map(decoded);
    const put = (value) => (value && value.array !== undefined ? arrays[value.array] : value);
    for (const trace of figure.data) { trace.x = put(trace.x); trace.y = put(trace.y); }
    return figure;
  };

  const plan = (chart) => {
    const figure = drawn.get(chart) || parsed(chart);
    drawn.set(chart, figure);
    const palette = palettes[dark.matches && !printing ? "dark" : "light"];
    const layout = coloured(figure.layouts[narrow.matches && !printing ? "narrow" : "wide"], palette);
    // Drawn larger than the paper and shrunk by the style sheet, so that nothing runs into its neighbour.
    if (printing) layout.width = chart.closest(".small") ? 560 : 940;
    if (figure.over_time && shared) layout.xaxis = { ...layout.xaxis, range: [...shared], autorange: false };
    // Names stand in the first drawing, wherever: to move them takes a tenth of what it takes to add them.
    const names = bearers(figure.data, layout).map((trace) => endName(trace, { right: 1, place: 0.5 }));
    layout.annotations = [...(layout.annotations || []), ...coloured(names, palette)];
    const data = printing ? figure.data.map(forPaper) : forScreen(figure);
    sayDetail(chart, figure);
    return [coloured(data, palette), layout, { ...config, displayModeBar: narrow.matches ? false : "hover" }];
  };

  // The last point in view of a line, as fractions of its axes' lengths.
  const endOf = ({ x, y }, xAxis, yAxis) => {
    const along = (axis, value) => ((axis.type === "log" ? Math.log10(value) : value) - axis.range[0]) / (axis.range[1] - axis.range[0]);
    for (let at = x.length - 1; at >= 0; at--)
      if (Number.isFinite(y[at]) && along(xAxis, x[at]) <= 1.0001) return { right: along(xAxis, x[at]), place: along(yAxis, y[at]) };
    return null;
  };

  // Places between 0 and 1, moved until none is nearer to another than `apart`.
  const spread = (names, apart) => {
    names.sort((a, b) => a.place - b.place);
    let floor = 0, ceiling = 1;
    for (const name of names) floor = (name.place = Math.max(floor, Math.min(1, name.place))) + apart;
    for (const name of [...names].reverse()) ceiling = (name.place = Math.min(ceiling, name.place)) - apart;
    return names;
  };

  // Lines bear their names at their ends, in the panels at the right edge; a zoom moves the ends.
  const END_PX = 14;
  const axisOf = (layout, name) => layout[name[0] + "axis" + name.slice(1)];
  const bearers = (data, layout) => data.filter((trace) => trace.meta?.end && !(axisOf(layout, trace.xaxis).domain?.[1] < 0.99));
  const endName = (trace, { right, place }) => ({
    name: "end", text: trace.name, xref: trace.xaxis + " domain", x: right, xanchor: "left", xshift: 4, align: "left", showarrow: false,
    yref: trace.yaxis + " domain", y: place, yanchor: "middle", font: { color: trace.line.color, size: narrow.matches ? 11 : 12 },
  });
  const nameEnds = (chart) => {
    const { _fullLayout: full, data, layout } = chart, panels = new Map();
    const high = full.height - full.margin.t - full.margin.b;
    for (const trace of bearers(data, full)) {
      const xAxis = axisOf(full, trace.xaxis), yAxis = axisOf(full, trace.yaxis);
      const end = endOf(trace, xAxis, yAxis);
      if (!end || end.right < 0) continue;
      if (!panels.has(yAxis)) panels.set(yAxis, []);
      panels.get(yAxis).push({ ...end, trace });
    }
    const ends = [...panels].flatMap(([axis, names]) => spread(names, END_PX / (high * (axis.domain[1] - axis.domain[0])))).map((name) => endName(name.trace, name));
    const others = (layout.annotations || []).filter((one) => one.name !== "end");
    return Plotly.react(chart, data, { ...layout, annotations: [...others, ...ends] });
  };

  const draw = (chart) => {
    const first = !drawn.has(chart);
    const done = Plotly.react(chart, ...plan(chart)).then(() => nameEnds(chart));
    if (!first) return done;
    chart.on("plotly_relayout", () => { if (!spreading) nameEnds(chart); });
    chart.on("plotly_restyle", () => nameEnds(chart));
    if (drawn.get(chart).over_time) chart.on("plotly_relayout", (change) => followTime(chart, change));
    chart.addEventListener("keydown", (event) => onKey(chart, event));
    return done;
  };

  const showTime = (range, except) => {
    shared = range;
    spreading = true;
    const overTime = [...drawn].filter(([, figure]) => figure.over_time).map(([chart]) => chart);
    // The one in which somebody zoomed shows the range already, but may have more to show of it.
    const zoomed = overTime.filter((chart) => chart !== except || seriesOf(chart).length);
    if (except) sayDetail(except, drawn.get(except));
    Promise.all(zoomed.map((chart) => zoom(chart, range)))
      .then(() => Promise.all(overTime.map(nameEnds)))
      .finally(() => { spreading = false; });
  };

  const followTime = (chart, change) => {
    if (spreading) return;
    const axis = Object.keys(change).map((key) => /^xaxis\d*/.exec(key)).find(Boolean);
    if (!axis) return;
    const from = change[axis[0] + ".range[0]"], to = change[axis[0] + ".range[1]"];
    if (from !== undefined) showTime([from, to], chart);
    else if (change[axis[0] + ".range"]) showTime(change[axis[0] + ".range"], chart);
    else if (change[axis[0] + ".autorange"]) showTime(null, chart);
  };

  const onKey = (chart, event) => {
    if (event.target !== chart || !drawn.get(chart).over_time) return;
    const [from, to] = chart.layout.xaxis.range;
    const width = to - from;
    const ranges = {
      "+": [from + width / 4, to - width / 4],
      "-": [from - width / 2, to + width / 2],
      "−": [from - width / 2, to + width / 2],
      ArrowLeft: [from - width / 4, to - width / 4],
      ArrowRight: [from + width / 4, to + width / 4],
      0: null,
    };
    if (!(event.key in ranges)) return;
    event.preventDefault();
    showTime(ranges[event.key], null);
  };

  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      watcher.unobserve(entry.target);
      draw(entry.target);
    }
  }, { rootMargin: "600px" });

  // The chart library comes compressed: a page of 8 MB takes 5. What is made of it must be what the policy's
  // hash names, or it does not run.
  const library = async () => {
    const packed = document.getElementById("plotly");
    if (!packed) return false;
    const bytes = Uint8Array.from(atob(packed.textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    return true;
  };

  for (const chart of charts) {
    const layouts = JSON.parse(document.getElementById("data-" + chart.dataset.key).textContent).layouts;
    const resize = () => {
      if (!drawn.has(chart)) chart.style.minHeight = layouts[narrow.matches ? "narrow" : "wide"].height + "px";
    };
    resize();
    narrow.addEventListener("change", resize);
  }
  library().then(() => charts.forEach((chart) => watcher.observe(chart)), () => {
    for (const chart of charts) chart.textContent = "This browser is too old to draw the chart.";
  });
  const redraw = () => { for (const chart of drawn.keys()) draw(chart); };
  dark.addEventListener("change", redraw);
  narrow.addEventListener("change", redraw);

  // A link into a folded chapter opens it.
  const unfold = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    if (!target) return;
    for (let fold = target.querySelector(":scope > details") || target.closest("details"); fold; fold = fold.parentElement.closest("details"))
      fold.open = true;
    target.scrollIntoView();
  };
  addEventListener("hashchange", unfold);
  unfold();

  // Paper shows all that is folded, unless one page is wanted. What was not seen before waits again afterwards.
  let opened = [], unseen = [];
  addEventListener("beforeprint", () => {
    printing = true;
    unseen = charts.filter((chart) => !drawn.has(chart));
    const summary = document.documentElement.dataset.print === "summary";
    opened = summary ? [] : [...document.querySelectorAll("details:not([open])")];
    for (const fold of opened) fold.open = true;
    if (window.Plotly) charts.filter((chart) => !summary || chart.closest("#verdict")).forEach(draw);
  });
  addEventListener("afterprint", () => {
    printing = false;
    delete document.documentElement.dataset.print;
    for (const fold of opened) fold.open = false;
    for (const chart of drawn.keys()) unseen.includes(chart) ? watcher.observe(chart) : draw(chart);
  });
  for (const button of document.querySelectorAll("button[data-print]"))
    button.addEventListener("click", () => {
      document.documentElement.dataset.print = button.dataset.print;
      print();
    });
})();
