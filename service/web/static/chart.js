// The three stacked charts of a zone: temperature against its interval, volatility, learning gate.

/* global Plotly */

const CONFIG = { displayModeBar: false, responsive: true };

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Runs of rows without a missing interval, so that nothing is drawn across a gap.
function runs(rows, period) {
  const found = [];
  let last = null;
  for (const row of rows) {
    const time = Date.parse(row.time);
    if (last === null || time - last > 1.5 * period * 1000) found.push([]);
    found.at(-1).push(row);
    last = time;
  }
  return found;
}

function line(parts, key, extra) {
  const x = [];
  const y = [];
  for (const part of parts) {
    for (const row of part) {
      x.push(row.time);
      y.push(row[key]);
    }
    x.push(part.at(-1).time);
    y.push(null);
  }
  return { type: "scatter", mode: "lines", x, y, connectgaps: false, ...extra };
}

// One closed polygon per run; a row without bounds ends the polygon.
function band(parts, lower, upper, extra) {
  const x = [];
  const y = [];
  for (const part of parts) {
    let open = [];
    const close = () => {
      if (open.length > 1) {
        const back = open.toReversed();
        x.push(...open.map((row) => row.time), ...back.map((row) => row.time), null);
        y.push(...open.map((row) => row[upper]), ...back.map((row) => row[lower]), null);
      }
      open = [];
    };
    for (const row of part) {
      if (row[lower] === null || row[upper] === null) close();
      else open.push(row);
    }
    close();
  }
  return { type: "scatter", mode: "lines", x, y, fill: "toself", line: { width: 0 }, hoverinfo: "skip", ...extra };
}

function next(forecast) {
  const interval = forecast.intervals[0];
  return {
    type: "scatter",
    mode: "markers",
    name: "next",
    x: [forecast.valid_time],
    y: [forecast.mean],
    error_y: interval && {
      type: "data",
      symmetric: false,
      array: [interval.upper - forecast.mean],
      arrayminus: [forecast.mean - interval.lower],
      color: colour("--accent"),
      thickness: 1.5,
      width: 4,
    },
    marker: { color: colour("--accent"), size: 6 },
    hovertemplate: "%{y:.2f} °C forecast<extra></extra>",
  };
}

// All that was measured, and all of the intervals but the widest few: the first forecasts of a zone would flatten the rest.
function temperatures(rows, forecast) {
  const known = (key) => rows.map((row) => row[key]).filter((value) => value !== null);
  const quantile = (values, level) => values.sort((a, b) => a - b)[Math.round(level * (values.length - 1))];
  const edges = [...known("y"), ...(forecast ? [forecast.mean] : [])];
  const [lower, upper] = [known("lower"), known("upper")];
  if (lower.length) edges.push(quantile(lower, 0.05), quantile(upper, 0.95));
  if (!edges.length) return undefined;
  const [low, high] = [Math.min(...edges), Math.max(...edges)];
  const margin = Math.max(0.06 * (high - low), 0.1);
  return [low - margin, high + margin];
}

// Without volatility (EKF, UKF) there is neither alpha nor a gate that moves: the temperature has all the room.
function hasVolatility(rows) {
  return rows.some((row) => row.alpha_median !== null);
}

function layout(width, volatile, range) {
  const axis = {
    gridcolor: colour("--line"),
    linecolor: colour("--line"),
    zeroline: false,
    fixedrange: true,
    automargin: true,
  };
  const named = (text, domain, extra = {}) => ({
    ...axis,
    domain,
    title: { text, standoff: 6, font: { size: 12 } },
    ...extra,
  });
  return {
    margin: { l: 46, r: 8, t: 8, b: 28 },
    showlegend: false,
    hovermode: "x",
    dragmode: false,
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("--muted"), size: 11.5, family: "system-ui, sans-serif" },
    hoverlabel: { font: { family: "system-ui, sans-serif" } },
    xaxis: { ...axis, anchor: volatile ? "y3" : "y", type: "date", tickangle: 0, nticks: Math.max(3, Math.floor(width / 60)) },
    yaxis: named("°C", [volatile ? 0.44 : 0, 1], { range }),
    ...(volatile && {
      yaxis2: named("α", [0.2, 0.38], { type: "log", dtick: 1, minor: { showgrid: false } }),
      yaxis3: named("gate", [0, 0.14], { range: [-0.05, 1.05], tickvals: [0, 0.5, 1] }),
    }),
  };
}

function volatility(parts) {
  return [
    band(parts, "alpha_lower", "alpha_upper", { yaxis: "y2", fillcolor: colour("--alpha-band") }),
    line(parts, "alpha_median", {
      yaxis: "y2",
      line: { color: colour("--alpha"), width: 1.4 },
      hovertemplate: "α %{y:.2f}<extra></extra>",
    }),
    line(parts, "gate", {
      yaxis: "y3",
      line: { color: colour("--gate"), width: 1.4, shape: "hv" },
      hovertemplate: "gate %{y:.2f}<extra></extra>",
    }),
  ];
}

export function draw(node, rows, forecast, period) {
  const parts = runs(rows, period);
  const accent = colour("--accent");
  const volatile = hasVolatility(rows);
  const traces = [
    band(parts, "lower", "upper", { fillcolor: colour("--band") }),
    line(parts, "mean", {
      line: { color: accent, width: 1.2 },
      hovertemplate: "%{y:.2f} °C mean<extra></extra>",
    }),
    line(parts, "y", {
      line: { color: colour("--ink"), width: 1.4 },
      hovertemplate: "%{y:.2f} °C measured<extra></extra>",
    }),
    ...(forecast ? [next(forecast)] : []),
    ...(volatile ? volatility(parts) : []),
  ];
  return Plotly.react(node, traces, layout(node.clientWidth, volatile, temperatures(rows, forecast)), CONFIG);
}
