// Elements without HTML in strings: whatever a name contains, it is text.

export function element(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  set(node, properties);
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

const SVG = "http://www.w3.org/2000/svg";

export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

// Properties by their names in JavaScript; `aria-...`, `role` and `data-...` as attributes.
export function set(node, properties) {
  for (const [name, value] of Object.entries(properties)) {
    if (name.includes("-") || name === "role" || name === "for" || name === "datetime") {
      if (value === null || value === undefined) node.removeAttribute(name);
      else node.setAttribute(name, value);
    } else if (node[name] !== value) node[name] = value;
  }
}

export function tableRow(tag, cells) {
  return element("tr", {}, ...cells.map((cell) => element(tag, tag === "th" ? { scope: "col" } : {}, cell)));
}

// `work`, at most once per `pause` ms, however often it is asked for.
export function paced(work, pause) {
  let timer = null;
  let last = -Infinity;
  const run = () => {
    timer = null;
    last = performance.now();
    work();
  };
  const ask = () => {
    if (timer === null) timer = setTimeout(run, Math.max(0, last + pause - performance.now()));
  };
  ask.cancel = () => {
    clearTimeout(timer);
    timer = null;
  };
  return ask;
}
