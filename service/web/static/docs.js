// The API's documentation, drawn from the daemon's own openapi.json: nothing is loaded from elsewhere.

import { KeyNeeded, askForKey, request } from "./access.js";

const description = await (await fetch("openapi.json")).json();
const schemas = description.components.schemas;

function element(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

function table(head, rows) {
  return element(
    "div",
    { className: "scroll" },
    element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...head.map((text) => element("th", { textContent: text })))),
      element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map((cell) => element("td", {}, cell))))),
    ),
  );
}

// A schema as text; references to objects become links to the schema's own section.
function describe(schema) {
  if (!schema) return "";
  if (schema.$ref) {
    const name = schema.$ref.split("/").at(-1);
    if (!schemas[name].properties) return describe(schemas[name]);
    return element("a", { href: `#schema-${name}`, textContent: name });
  }
  const options = schema.anyOf ?? schema.oneOf;
  if (options) {
    const parts = options.flatMap((option, index) => (index ? [" or ", describe(option)] : [describe(option)]));
    return element("span", {}, ...parts);
  }
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if (schema.type === "array") return element("span", {}, "list of ", describe(schema.items));
  if (schema.type === "object" && schema.additionalProperties) {
    return element("span", {}, "object of ", describe(schema.additionalProperties));
  }
  return schema.format ?? schema.type ?? "any";
}

function parameterRows(operation) {
  return (operation.parameters ?? []).map((parameter) => [
    element("code", { textContent: parameter.name }),
    parameter.in + (parameter.required ? ", required" : ""),
    describe(parameter.schema),
    parameter.description ?? parameter.schema?.description ?? "",
  ]);
}

function responseRows(operation) {
  return Object.entries(operation.responses).map(([status, response]) => {
    const [media, content] = Object.entries(response.content ?? {})[0] ?? ["", {}];
    return [status, response.description, media, describe(content.schema)];
  });
}

function bodySchema(operation) {
  const reference = operation.requestBody?.content?.["application/json"]?.schema?.$ref;
  return reference && schemas[reference.split("/").at(-1)];
}

function tryIt(path, method, operation) {
  const fields = (operation.parameters ?? []).map((parameter) => {
    const input = element("input", { name: parameter.name, required: parameter.required ?? false });
    if (parameter.schema?.type === "array") input.placeholder = "several: separate by commas";
    return { parameter, input };
  });
  const example = bodySchema(operation)?.examples?.[0];
  const body = example && element("textarea", { value: JSON.stringify(example, null, 2) });
  const output = element("pre", { hidden: true });
  const form = element(
    "form",
    {},
    ...fields.flatMap(({ parameter, input }) => [element("label", { textContent: parameter.name }), input]),
    ...(body ? [body] : []),
    element("button", { textContent: "Send" }),
  );
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    let url = path.slice(1);
    const query = new URLSearchParams();
    for (const { parameter, input } of fields) {
      if (parameter.in === "path") url = url.replace(`{${parameter.name}}`, encodeURIComponent(input.value));
      else if (parameter.schema?.type === "array") {
        for (const value of input.value.split(",").filter((text) => text.trim())) query.append(parameter.name, value.trim());
      } else if (input.value) query.append(parameter.name, input.value);
    }
    if (query.size) url += `?${query}`;
    const options = body ? { method, body: body.value, headers: { "Content-Type": "application/json" } } : { method };
    try {
      const response = await request(url, options);
      const text = await response.text();
      const isJson = response.headers.get("content-type")?.includes("json");
      output.textContent = `${method} ${url}\n${response.status} ${response.statusText}\n\n${
        isJson ? JSON.stringify(JSON.parse(text), null, 2) : text
      }`;
    } catch (error) {
      output.textContent = error instanceof KeyNeeded ? "This needs an API key." : String(error);
      if (error instanceof KeyNeeded) askForKey(error.message, () => form.requestSubmit());
    }
    output.hidden = false;
  });
  return element("div", {}, form, output);
}

function operationCard(path, method, operation) {
  const parameters = parameterRows(operation);
  const body = operation.requestBody?.content?.["application/json"]?.schema;
  return element(
    "details",
    { className: "card operation" },
    element(
      "summary",
      {},
      element("span", { className: "method", textContent: method }),
      element("span", { className: "path", textContent: path }),
      ` – ${operation.summary ?? ""}`,
    ),
    ...(parameters.length
      ? [element("h3", { textContent: "Parameters" }), table(["name", "in", "type", ""], parameters)]
      : []),
    ...(body ? [element("h3", { textContent: "Body" }), element("p", {}, describe(body))] : []),
    element("h3", { textContent: "Responses" }),
    table(["status", "", "media type", "schema"], responseRows(operation)),
    element("h3", { textContent: "Try" }),
    tryIt(path, method, operation),
  );
}

function schemaCard(name, schema) {
  const required = new Set(schema.required ?? []);
  const rows = Object.entries(schema.properties ?? {}).map(([field, inner]) => [
    element("code", { textContent: field }),
    describe(inner),
    required.has(field) ? "" : "optional",
    inner.description ?? "",
  ]);
  return element(
    "details",
    { className: "card operation", id: `schema-${name}` },
    element("summary", {}, element("code", { textContent: name }), ` – ${schema.description ?? ""}`),
    table(["field", "type", "", ""], rows),
  );
}

function openTarget() {
  const target = document.getElementById(location.hash.slice(1));
  if (target instanceof HTMLDetailsElement) {
    target.open = true;
    target.scrollIntoView();
  }
}

document.getElementById("about").textContent = `${description.info.description} Version ${description.info.version}.`;
document.getElementById("operations").append(
  ...Object.entries(description.paths).flatMap(([path, methods]) =>
    Object.entries(methods).map(([method, operation]) => operationCard(path, method.toUpperCase(), operation)),
  ),
);
document.getElementById("schemas").append(
  ...Object.entries(schemas)
    .filter(([, schema]) => schema.properties)
    .map(([name, schema]) => schemaCard(name, schema)),
);
window.addEventListener("hashchange", openTarget);
openTarget();
