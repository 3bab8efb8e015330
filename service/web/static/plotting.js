// plotly.js, loaded once when a zone is first looked at, and what all charts share: colours, gaps, the site's clock.

import { element } from "./dom.js";
import { LANGUAGES, celsius, language } from "./text.js";
import { offset, utcText } from "./time.js";

let loading = null;

export function loadPlotly() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = `static/plotly.min.js?v=${document.documentElement.dataset.plotly}`;
    script.addEventListener("load", () => {
      // It knows English by itself.
      for (const name of LANGUAGES.slice(1)) window.Plotly.register(chartLocale(name));
      resolve(window.Plotly);
    });
    script.addEventListener("error", () => {
      loading = null;
      script.remove();
      reject(new Error("plotly.min.js could not be loaded"));
    });
    document.head.append(script);
  });
  return loading;
}

// Names of days and months as the browser knows them, the day before the month.
function chartLocale(name) {
  const named = (options, dates) => dates.map((date) => new Intl.DateTimeFormat(name, { ...options, timeZone: "UTC" }).format(date));
  const days = Array.from({ length: 7 }, (_, index) => Date.UTC(2023, 0, 1 + index));
  const months = Array.from({ length: 12 }, (_, index) => Date.UTC(2023, index, 1));
  return {
    moduleType: "locale",
    name,
    dictionary: {},
    format: {
      days: named({ weekday: "long" }, days),
      shortDays: named({ weekday: "short" }, days),
      months: named({ month: "long" }, months),
      shortMonths: named({ month: "short" }, months),
      periods: ["AM", "PM"],
      dateTime: "%a %-d. %b %Y %X",
      date: "%d.%m.%Y",
      time: "%H:%M:%S",
      year: "%Y",
      month: "%b %Y",
      dayMonth: "%-d. %b",
      dayMonthYear: "%-d. %b %Y",
      currency: ["", ""],
      grouping: [3],
      decimal: (0.5).toLocaleString(name).charAt(1),
      thousands: (1000).toLocaleString(name).charAt(1),
    },
  };
}

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// One clock for a whole chart: that of its end. So an hour has the same length even where summer time begins.
export function chartClock(end) {
  const shift = offset(end);
  return {
    x: (time) => new Date(time + shift).toISOString().slice(0, 19),
    time: (x) => (typeof x === "number" ? x : Date.parse(`${String(x).replace(" ", "T")}Z`)) - shift,
  };
}

// Runs of neighbouring buckets that are wanted: nothing is drawn across a gap.
export function runs(times, bucket, present) {
  const found = [];
  let last = null;
  times.forEach((time, index) => {
    if (!present(index)) {
      last = null;
      return;
    }
    if (last === null || time - last > 1.5 * bucket) found.push([]);
    found.at(-1).push(index);
    last = time;
  });
  return found;
}

// A line that breaks at gaps; with `utc`, its hovertemplate may name the time in UTC by %{text}.
export function line(clock, times, bucket, values, { utc = false, ...extra }) {
  const x = [];
  const y = [];
  const text = [];
  for (const run of runs(times, bucket, (index) => values[index] !== null)) {
    for (const index of run) {
      x.push(clock.x(times[index]));
      y.push(values[index]);
      if (utc) text.push(utcText(times[index]));
    }
    const end = times[run.at(-1)] + bucket;
    if (extra.line?.shape === "hv" || run.length === 1) {
      // A step lasts to the end of its bucket; so does a single sample between two gaps, which would not show.
      x.push(clock.x(end));
      y.push(values[run.at(-1)]);
      if (utc) text.push(utcText(end));
    }
    x.push(clock.x(end));
    y.push(null);
    if (utc) text.push("");
  }
  return { type: "scatter", mode: "lines", connectgaps: false, x, y, ...(utc && { text }), ...extra };
}

// What the lines of a chart are; `entries` have a label, a colour, and whether the line is dashed.
export function legend(place, entries) {
  place.replaceChildren(
    ...entries.map(({ label, colour: own, dash }) => {
      const swatch = element("span", { className: `swatch ${dash ?? ""}`, "aria-hidden": "true" });
      swatch.style.borderColor = own;
      return element("li", {}, swatch, label);
    }),
  );
}

// The area between two bounds, one closed polygon for each run.
export function band(clock, times, bucket, lower, upper, extra) {
  const x = [];
  const y = [];
  for (const run of runs(times, bucket, (index) => lower[index] !== null && upper[index] !== null)) {
    const back = run.toReversed();
    x.push(...run.map((index) => clock.x(times[index])), ...back.map((index) => clock.x(times[index])), null);
    y.push(...run.map((index) => upper[index]), ...back.map((index) => lower[index]), null);
  }
  return { type: "scatter", mode: "lines", x, y, fill: "toself", line: { width: 0 }, hoverinfo: "skip", ...extra };
}

// plotly.js keeps the size of every label that it measures, by text and position: a chart that moves with time would fill its
// memory with them. So labels keep their angle, may reach beyond the axis, and leave the axis's name to an annotation.
const UNMEASURED = { automargin: false, tickangle: 0, ticklabeloverflow: "allow" };

// The layout of a chart with these axes; `named` has the text beside the vertical ones, by their names.
export function layout(axes, named) {
  const axis = { gridcolor: colour("--line"), linecolor: colour("--line"), zeroline: false, ...UNMEASURED };
  const drawn = Object.fromEntries(Object.entries(axes).map(([name, own]) => [name, { ...axis, ...(name === "xaxis" ? {} : { fixedrange: true }), ...own }]));
  const annotations = Object.entries(named).map(([name, text]) => {
    const [low, high] = axes[name].domain ?? [0, 1];
    return { text, textangle: -90, showarrow: false, xref: "paper", yref: "paper", x: 0, xshift: -45, y: (low + high) / 2, xanchor: "center", yanchor: "middle", font: { size: 12 } };
  });
  return {
    margin: { l: 56, r: 38, t: 10, b: 44 },
    showlegend: false,
    hovermode: "x unified",
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("--muted"), size: 12, family: "system-ui, sans-serif" },
    hoverlabel: { bgcolor: colour("--card"), bordercolor: colour("--line"), font: { color: colour("--ink"), family: "system-ui, sans-serif" } },
    annotations,
    ...drawn,
  };
}

export const chartConfig = () => ({ displayModeBar: false, responsive: true, doubleClick: false, showTips: false, locale: language });

// The values that a temperature axis must show: all measurements, and all of the band but its widest few.
export function temperatureRange(measured, lower, upper) {
  const known = (values) => values.filter((value) => value !== null && value !== undefined);
  const at = (values, level) => values.toSorted((a, b) => a - b)[Math.round(level * (values.length - 1))];
  const edges = known(measured);
  const [low, high] = [known(lower), known(upper)];
  if (low.length) edges.push(at(low, 0.03), at(high, 0.97));
  if (!edges.length) return undefined;
  const [least, most] = [edges.reduce((a, b) => Math.min(a, b)), edges.reduce((a, b) => Math.max(a, b))];
  const margin = Math.max(0.06 * (most - least), 0.1);
  return [least - margin, most + margin];
}

// The same for a fan: what is likely is shown whole, and the rest of a band that says next to nothing is cut off.
// Returns the range, and whether anything was cut off.
export function fanRange(drawn, likely, possible) {
  const edges = [...drawn, ...likely].filter((value) => value !== null && value !== undefined);
  const [least, most] = [edges.reduce((a, b) => Math.min(a, b)), edges.reduce((a, b) => Math.max(a, b))];
  const room = Math.max(2 * (most - least), 5);
  const whole = temperatureRange(edges, possible.lower, possible.upper);
  const range = [Math.max(whole[0], least - room), Math.min(whole[1], most + room)];
  return { range, cut: range[0] > whole[0] || range[1] < whole[1] };
}

export function spanText(values) {
  const known = values.filter((value) => value !== null);
  if (!known.length) return null;
  return { low: celsius(known.reduce((a, b) => Math.min(a, b))), high: celsius(known.reduce((a, b) => Math.max(a, b))) };
}
