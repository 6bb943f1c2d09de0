
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
    if (Array.isArray(value)) return value.map((item) => coloured(item, palette));
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item, palette)]));
    return value;
  };

  // Paper shows no more than this, and every point costs some 50 bytes of PDF.
  const mostPoints = { lines: 1600, markers: 900 };

  const decoded = ({ dtype, bdata }) => {
    const bytes = Uint8Array.from(atob(bdata), (letter) => letter.charCodeAt(0));
    return dtype === "f8" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
  };

  // Lines keep the lowest and the highest value and the first gap of each block of points, clouds every n-th point.
  const thinned = (trace) => {
    if (!trace.x || !trace.x.bdata || trace.fill) return trace;
    const x = decoded(trace.x), y = decoded(trace.y), lines = trace.mode === "lines";
    const size = Math.ceil((lines ? 2 : 1) * x.length / mostPoints[trace.mode]);
    if (size < 2) return trace;
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
    return { ...trace, x: kept.map((at) => x[at]), y: kept.map((at) => y[at]) };
  };

  // A PDF keeps each see-through point as a picture of its own: the same page takes six times the bytes.
  const forPaper = (trace) =>
    ({ ...thinned(trace), ...(trace.marker && trace.x.bdata ? { marker: { ...trace.marker, opacity: 1 } } : {}) });

  // Arrays that several traces have in common stand once in the page.
  const parsed = (chart) => {
    const figure = JSON.parse(document.getElementById("data-" + chart.dataset.key).textContent);
    const put = (value) => (value && value.array !== undefined ? figure.arrays[value.array] : value);
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
    const data = printing ? figure.data.map(forPaper) : figure.data;
    return [coloured(data, palette), layout, { ...config, displayModeBar: narrow.matches ? false : "hover" }];
  };

  const draw = (chart) => {
    const first = !drawn.has(chart);
    const done = Plotly.react(chart, ...plan(chart));
    if (!first) return done;
    if (drawn.get(chart).over_time) chart.on("plotly_relayout", (change) => followTime(chart, change));
    chart.addEventListener("keydown", (event) => onKey(chart, event));
    return done;
  };

  const showTime = (range, except) => {
    shared = range;
    spreading = true;
    const zoomed = [...drawn].filter(([chart, figure]) => figure.over_time && chart !== except).map(([chart]) =>
      Plotly.relayout(chart, range ? { "xaxis.range": [...range] } : { "xaxis.autorange": true }));
    Promise.all(zoomed).finally(() => { spreading = false; });
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

  for (const chart of charts) {
    const layouts = JSON.parse(document.getElementById("data-" + chart.dataset.key).textContent).layouts;
    const resize = () => {
      if (!drawn.has(chart)) chart.style.minHeight = layouts[narrow.matches ? "narrow" : "wide"].height + "px";
    };
    resize();
    narrow.addEventListener("change", resize);
    watcher.observe(chart);
  }
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

  // Paper shows all that is folded, unless one page is wanted.
  let opened = [];
  addEventListener("beforeprint", () => {
    printing = true;
    const summary = document.documentElement.dataset.print === "summary";
    opened = summary ? [] : [...document.querySelectorAll("details:not([open])")];
    for (const fold of opened) fold.open = true;
    charts.filter((chart) => !summary || chart.closest("#verdict")).forEach(draw);
  });
  addEventListener("afterprint", () => {
    printing = false;
    delete document.documentElement.dataset.print;
    for (const fold of opened) fold.open = false;
    redraw();
  });
  for (const button of document.querySelectorAll("button[data-print]"))
    button.addEventListener("click", () => {
      document.documentElement.dataset.print = button.dataset.print;
      print();
    });
})();
