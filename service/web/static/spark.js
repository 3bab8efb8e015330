// A sparkline: the last day of a room as a small SVG. What was not measured is not drawn.

import { svg } from "./dom.js";

const WIDTH = 120;
const HEIGHT = 28;
const LEAST_SPAN = 1.0;

// The path of `values` (degC, null: not measured), scaled to at least 1 K so that noise looks like noise.
export function sparkPath(values, width = WIDTH, height = HEIGHT) {
  const known = values.filter((value) => value !== null);
  if (known.length < 2) return "";
  const low = Math.min(...known);
  const high = Math.max(...known);
  const span = Math.max(LEAST_SPAN, high - low);
  const middle = (low + high) / 2;
  const x = (index) => ((index / (values.length - 1)) * (width - 2) + 1).toFixed(1);
  const y = (value) => (height / 2 - ((value - middle) / span) * (height - 4)).toFixed(1);
  let path = "";
  let open = false;
  values.forEach((value, index) => {
    if (value === null) open = false;
    else {
      path += `${open ? "L" : "M"}${x(index)} ${y(value)}`;
      open = true;
    }
  });
  return path;
}

export function sparkline() {
  const path = svg("path", { class: "spark-line" });
  const node = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "spark", role: "img", preserveAspectRatio: "none" }, path);
  let shown = null;
  return {
    node,
    draw(spark, label) {
      node.setAttribute("aria-label", label);
      if (spark === shown) return;
      shown = spark;
      path.setAttribute("d", spark ? sparkPath(spark.values) : "");
    },
  };
}
