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

/** A response that is no failure. @param {string} path @param {RequestInit} options */
async function responded(path, options) {
  let response;
  try {
    response = await fetch(path, { ...options, signal: AbortSignal.timeout(PATIENCE_MS) });
  } catch {
    throw new Failed(0, null);
  }
  if (response.ok) return response;
  const body = await response.json().catch(() => null);
  throw new Failed(response.status, body && typeof body.found === "string" ? body : null);
}

/** @param {string} path @param {RequestInit} options */
const answer = async (path, options) => (await responded(path, options)).json().catch(() => null);

/** A request that changes something. @param {object} body @returns {RequestInit} */
const posted = (body) => ({ method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });

/** @param {string} path */
export const get = (path) => answer(path, {});

/** @param {string} path @param {object} [body] */
export const post = (path, body = {}) => answer(path, posted(body));

/**
 * Has the browser keep the bytes that a request answers with under a name, as a download.
 *
 * @param {string} path @param {string} name
 */
export async function save(path, name) {
  const response = await responded(path, posted({}));
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
