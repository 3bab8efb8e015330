// The API key, where the daemon wants one: asked for in the page, kept by this tab until it is closed.

const STORED = "thermogate-key";
const FORM = "access";

export class KeyNeeded extends Error {}

// fetch, with the key if there is one. Rejects with KeyNeeded if that is missing or wrong.
export async function request(path, options = {}) {
  const key = sessionStorage.getItem(STORED);
  const headers = key ? { ...options.headers, Authorization: `Bearer ${key}` } : options.headers;
  const response = await fetch(path, { ...options, headers });
  if (response.status === 401 || (response.status === 429 && response.headers.has("WWW-Authenticate"))) {
    sessionStorage.removeItem(STORED);
    throw new KeyNeeded(key ? "This key is wrong, revoked or expired." : "");
  }
  return response;
}

// Shows the form once, and calls `done` when a key has been entered. `texts` are those of the field and the button.
export function askForKey(reason, done, texts = { label: "API key", open: "Open" }) {
  if (document.getElementById(FORM)) return;
  const label = document.createElement("label");
  const input = document.createElement("input");
  const button = document.createElement("button");
  const note = document.createElement("span");
  const form = document.createElement("form");
  Object.assign(input, { type: "password", required: true, autocomplete: "off", spellcheck: false, size: 48 });
  Object.assign(input, { pattern: "\\s*tg_[A-Za-z0-9_\\-]+\\s*", title: "a key begins with tg_" });
  Object.assign(note, { className: "error", role: "alert", textContent: reason });
  Object.assign(form, { id: FORM });
  label.append(`${texts.label} `, input);
  button.textContent = texts.open;
  form.append(label, button, note);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    sessionStorage.setItem(STORED, input.value.trim());
    form.remove();
    done();
  });
  document.querySelector("header").after(form);
  input.focus();
}
