/** What the page asks the desk for, beside the WebSocket. */

/** What went wrong, as the desk says it. @typedef {{place: string, found: string, remedy: string}} Problem */

/** In one line. @param {Problem} problem */
export const problem_words = ({ place, found, remedy }) =>
  [[place, found].filter(Boolean).join(": "), remedy].filter(Boolean).join(" – ");

/** A request that failed. */
export class Failed extends Error {
  /** @param {number} status @param {Problem | null} problem */
  constructor(status, problem) {
    super(problem ? problem_words(problem) : status ? `The desk answers ${status}.` : "The desk cannot be reached.");
    this.status = status;
    this.problem = problem;
  }
}

/** A request that takes longer is given up. */
const PATIENCE_MS = 30_000;

/** @param {string} path @param {RequestInit} options */
async function answer(path, options) {
  let response;
  try {
    response = await fetch(path, { ...options, signal: AbortSignal.timeout(PATIENCE_MS) });
  } catch {
    throw new Failed(0, null);
  }
  const body = await response.json().catch(() => null);
  if (!response.ok) throw new Failed(response.status, body && typeof body.found === "string" ? body : null);
  return body;
}

/** @param {string} path */
export const get = (path) => answer(path, {});

/** @param {string} path @param {object} [body] */
export const post = (path, body = {}) =>
  answer(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

/**
 * Has the browser keep the bytes that a request answers with under a name, as a download.
 *
 * @param {string} path @param {string} name
 */
export async function save(path, name) {
  let response;
  try {
    const headers = { "Content-Type": "application/json" };
    response = await fetch(path, { method: "POST", headers, body: "{}", signal: AbortSignal.timeout(PATIENCE_MS) });
  } catch {
    throw new Failed(0, null);
  }
  if (!response.ok) throw new Failed(response.status, await response.json().catch(() => null));
  const url = URL.createObjectURL(await response.blob());
  Object.assign(document.createElement("a"), { href: url, download: name }).click();
  // The browser has taken it by then.
  setTimeout(() => URL.revokeObjectURL(url), PATIENCE_MS);
}

/** A part of a path. @param {string | number} text */
const part = (text) => encodeURIComponent(text);

/** @param {string} box @param {string} action */
export const of_box = (box, action) => `/api/boxes/${part(box)}/${action}`;

/** @param {string} study @param {string} [action] */
export const of_study = (study, action) => `/api/studies/${part(study)}${action ? `/${action}` : ""}`;

/** The report of a study, or of one of its trials. @param {string} study @param {string[]} trial */
export const report_of = (study, ...trial) => `/reports/${[study, ...trial].map(part).join("/")}`;
