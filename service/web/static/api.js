// Requests to the daemon that serves the page.

import { request } from "./access.js";

// An answer that is an error; `detail` is the daemon's own sentence.
export class Refused extends Error {
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

async function answer(response) {
  if (response.ok) return response.json();
  let detail = `${response.status} ${response.statusText}`;
  try {
    detail = (await response.json()).detail ?? detail;
  } catch {
    // Something between the browser and the daemon answered; the status has to do.
  }
  throw new Refused(response.status, detail);
}

export async function get(path, signal) {
  return answer(await request(path, { headers: { Accept: "application/json" }, cache: "no-store", signal }));
}

// The same, but null where the daemon has no such thing (404), or not now (503).
export async function getIfAny(path, signal) {
  try {
    return await get(path, signal);
  } catch (error) {
    if (error instanceof Refused && (error.status === 404 || error.status === 503)) return null;
    throw error;
  }
}

export async function post(path, body, signal) {
  const headers = { "Content-Type": "application/json", Accept: "application/json" };
  return answer(await request(path, { method: "POST", headers, body: JSON.stringify(body), cache: "no-store", signal }));
}

export const zonePath = (id) => `zones/${encodeURIComponent(id)}`;
