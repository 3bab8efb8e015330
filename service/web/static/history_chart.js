// The history of a zone: measured against what was published, from an hour to a year, with the inputs below.

import { get, zonePath } from "./api.js";
import { element, paced, set } from "./dom.js";
import { band, chartClock, chartConfig, colour, layout, legend, line, loadPlotly, spanText, temperatureRange } from "./plotting.js";
import { t, unitText } from "./text.js";
import { moment } from "./time.js";
import { channelText } from "./words.js";

const HOUR = 3600_000;
const RANGES = [["minutes", HOUR / 6], ["hour", HOUR], ["day", 24 * HOUR], ["week", 7 * 24 * HOUR], ["month", 30 * 24 * HOUR], ["year", 365 * 24 * HOUR]];
const SHORTEST = 60_000;
const LIVE_MS = 5000;
const INPUT_COLOURS = { degC: ["--cold", "--alpha", "--gate"], W: ["--heat", "--alpha"], other: ["--sun", "--gate"] };

const SHORT_PERIOD = 30_000;

// The chart of zone `id`, whose samples come every `period` ms, with its controls; `expert()` tells whether alpha and gate are wanted, `failed(error)` is told
// what went wrong, and null once it works again. `newest` is called with the time of every newer sample.
export function historyChart(id, period, { expert, failed }) {
  const short = period < SHORT_PERIOD;
  const usual = short ? HOUR / 6 : 24 * HOUR;
  const plot = element("div", { className: "plot history", role: "img", tabIndex: -1 });
  const lines = element("ul", { className: "legend muted", "aria-label": t("chart.lines") });
  const note = element("p", { className: "muted chart-note", role: "status" });
  const shown = { end: null, span: usual, follows: true };
  let newest = null;
  let drawn = null;
  let asked = null;
  let dragging = "zoom";
  const coarse = window.matchMedia("(pointer: coarse)");
  const buttons = new Map();
  const controls = element("div", { className: "controls", role: "group", "aria-label": t("history.controls") });
  const button = (text, label, act) => {
    const node = element("button", { type: "button", textContent: text, title: label, "aria-label": label });
    node.addEventListener("click", act);
    controls.append(node);
    return node;
  };
  for (const [name, span] of RANGES.slice(short ? 0 : 1)) {
    buttons.set(span, button(t(`range.${name}`), t(`range.${name}.long`), () => show({ end: newest, span, follows: true })));
  }
  button("←", t("history.earlier"), () => move(-0.5));
  button("→", t("history.later"), () => move(0.5));
  button("+", t("history.closer"), () => zoom(0.5));
  button("−", t("history.wider"), () => zoom(2));
  const mode = button(t("history.pan"), t("history.pan.long"), () => {
    dragging = dragging === "zoom" ? "pan" : "zoom";
    set(mode, { "aria-pressed": String(dragging === "pan") });
    draw();
  });
  set(mode, { "aria-pressed": "false" });
  const from = element("input", { type: "date", "aria-label": t("history.date") });
  from.addEventListener("change", () => {
    const when = Date.parse(`${from.value}T00:00:00Z`);
    if (Number.isFinite(when)) {
      // That day by the site's clock; `chartClock` knows how far it is ahead.
      const start = chartClock(when).time(`${from.value}T00:00:00`);
      show({ end: start + 24 * HOUR, span: 24 * HOUR, follows: false });
    }
  });
  controls.append(from);
  const node = element("section", { className: "card" }, element("h2", { textContent: t("history.title") }), controls, plot, lines, note);

  function move(part) {
    const end = shown.end + part * shown.span;
    show({ end: Math.min(end, newest), span: shown.span, follows: end >= newest });
  }
  function zoom(factor) {
    const span = Math.min(RANGES.at(-1)[1], Math.max(SHORTEST, shown.span * factor));
    const end = shown.follows ? newest : shown.end + (span - shown.span) / 2;
    show({ end: Math.min(end, newest), span, follows: shown.follows || end >= newest });
  }
  function show(wanted) {
    Object.assign(shown, wanted);
    for (const [span, one] of buttons) set(one, { "aria-pressed": String(span === shown.span && shown.follows) });
    load();
  }

  const load = paced(async () => {
    if (newest === null) return;
    asked?.abort();
    const own = new AbortController();
    asked = own;
    const end = Math.ceil((shown.follows ? newest : shown.end) / 1000) * 1000;
    // Now, not with the answer: by then another stretch may have been asked for.
    shown.end = end;
    const start = end - shown.span;
    const points = Math.min(1200, Math.max(300, plot.clientWidth || 800));
    const query = new URLSearchParams({ start: new Date(start).toISOString(), end: new Date(end).toISOString(), points: String(Math.round(points)) });
    try {
      const [series] = await Promise.all([get(`${zonePath(id)}/series?${query}`, own.signal), loadPlotly()]);
      if (own !== asked) return;
      drawn = { series, start, end };
      await draw();
      failed(null);
    } catch (error) {
      if (error.name !== "AbortError") failed(error);
    }
  }, 100);
  const follow = paced(() => shown.follows && load(), LIVE_MS);

  let listening = false;
  async function draw() {
    if (!drawn || !node.isConnected) return;
    const { series, start, end } = drawn;
    const clock = chartClock(end);
    const { traces, entries, axes, named, lowest } = figure(series, clock, expert());
    const height = 120 + 90 * Object.keys(axes).length;
    plot.style.height = `${height}px`;
    const xaxis = { type: "date", range: [clock.x(start), clock.x(end)], anchor: lowest, nticks: Math.max(3, Math.floor(plot.clientWidth / 90)) };
    const wanted = layout({ ...axes, xaxis }, named);
    await window.Plotly.react(plot, traces, { ...wanted, height, dragmode: coarse.matches && dragging === "zoom" ? false : dragging }, chartConfig());
    if (!listening) {
      listening = true;
      plot.on("plotly_relayout", dragged);
      plot.on("plotly_doubleclick", () => show({ end: newest, span: usual, follows: true }));
    }
    legend(lines, entries);
    const span = spanText(series.y);
    const text = span
      ? t("history.summary", { from: moment(start), to: moment(end), ...span })
      : t("history.empty", { from: moment(start), to: moment(end) });
    plot.setAttribute("aria-label", text);
    // What is live is not read out again and again; a day that was asked for is told.
    note.textContent = span && shown.follows ? "" : text;
  }

  function dragged(change) {
    const range = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (!drawn || range[0] === undefined || range[0] === null) return;
    const clock = chartClock(drawn.end);
    const [start, end] = range.map((x) => clock.time(x));
    const span = Math.min(RANGES.at(-1)[1], Math.max(SHORTEST, end - start));
    show({ end: Math.min(end, newest), span, follows: end >= newest });
  }

  return {
    node,
    redraw: () => draw(),
    // There is a sample up to `time`.
    sample(time) {
      const first = newest === null;
      if (!first && time === newest) return;
      // A zone that was reset begins anew, earlier than what is shown.
      newest = time;
      if (first) note.textContent = t("loading");
      if (first) show({ end: time, span: shown.span, follows: true });
      else follow();
    },
    end() {
      asked?.abort();
      load.cancel();
      follow.cancel();
      if (window.Plotly && listening) window.Plotly.purge(plot);
    },
  };
}

// Traces and axes: temperatures on top, then a panel for each unit of the inputs, then what experts want to see. `entries` say
// what the lines are.
function figure(series, clock, expert) {
  const times = series.times.map((time) => Date.parse(time));
  const bucket = series.bucket_s * 1000;
  const traces = [];
  const entries = [];
  const panels = [];
  const area = (low, high, fill) => traces.push(band(clock, times, bucket, low, high, { yaxis: axis(), fillcolor: colour(fill) }));
  const drawn = (label, values, name, { hover, ...style }, own = {}) => {
    entries.push({ label, colour: colour(name), dash: style.dash });
    traces.push(line(clock, times, bucket, values, { yaxis: axis(), line: { color: colour(name), ...style }, hovertemplate: `${hover}<extra>${plain(label)}</extra>`, ...own }));
  };
  // The name of the axis whose panel is being filled.
  const axis = () => (panels.length ? `y${panels.length + 1}` : "y");
  const meant = series.setpoint ?? [];

  area(series.lower, series.upper, "--band");
  drawn(t("series.forecast"), series.mean, "--accent", { width: 1.2, hover: "%{y:.2f} °C" });
  if (series.bucket_s > series.period_s) area(series.y_low, series.y_high, "--ink-band");
  drawn(t("series.measured"), series.y, "--ink", { width: 1.5, hover: "%{y:.2f} °C · %{text}" }, { utc: true });
  if (meant.length) drawn(t("series.setpoint"), meant, "--good", { width: 1.3, dash: "dash", shape: "hv", hover: "%{y:.1f} °C" });
  panels.push(["°C", { range: temperatureRange([...series.y, ...meant], series.lower, series.upper) }]);
  for (const unit of new Set(series.inputs.map((input) => input.unit))) {
    const palette = INPUT_COLOURS[unit] ?? INPUT_COLOURS.other;
    const text = plain(unitText(unit));
    series.inputs.filter((input) => input.unit === unit).forEach((input, index) => {
      drawn(channelText(input.channel), input.values, palette[index % palette.length], { width: 1.3, shape: unit === "degC" ? "linear" : "hv", hover: `%{y:.4~g} ${text}` });
    });
    panels.push([text, { nticks: 4 }]);
  }
  if (series.gain) {
    area(series.gain.lower, series.gain.upper, "--gain-band");
    drawn(t("series.gain"), series.gain.median, "--gain", { width: 1.3, hover: "%{y:.3~g} W" });
    panels.push([t("series.gain_axis"), { nticks: 4, zeroline: true, zerolinecolor: colour("--line") }]);
  }
  if (expert && series.alpha.some((value) => value !== null)) {
    drawn("α", series.alpha, "--alpha", { width: 1.3, hover: "%{y:.2f}" });
    panels.push(["α", { type: "log", dtick: 1 }]);
    drawn("gate", series.gate, "--gate", { width: 1.3, shape: "hv", hover: "%{y:.2f}" });
    panels.push(["gate", { range: [-0.05, 1.05], tickvals: [0, 1] }]);
  }
  return { traces, entries, ...stacked(panels) };
}

// Axes one below the other, the first twice as high as the others, with the text beside each; `lowest` is the last in plotly's words.
function stacked(panels) {
  const gap = 0.05;
  const part = (1 - gap * (panels.length - 1)) / (panels.length + 1.3);
  const axes = {};
  const named = {};
  let top = 1;
  panels.forEach(([text, extra], index) => {
    const height = index === 0 ? (panels.length === 1 ? 1 : 2.3 * part) : part;
    const name = index === 0 ? "yaxis" : `yaxis${index + 1}`;
    axes[name] = { domain: [Math.max(0, top - height), top], ...extra };
    named[name] = text;
    top -= height + gap;
  });
  return { axes, named, lowest: panels.length === 1 ? "y" : `y${panels.length}` };
}

// plotly.js reads a little HTML in labels; a name is text.
export function plain(name) {
  return String(name).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll("%{", "% {");
}
