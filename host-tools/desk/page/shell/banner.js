/** What is to be known before anything else: the connection, and what is amiss of the desk as a whole. */

import { problem_words } from "../desk/requests.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";

/** A connection that is back within this time was hardly gone. */
const QUIET_MS = 700;

/** @param {{status: import("../desk/connection.js").Status, again: () => void, is_recording: boolean}} properties */
export function ConnectionBanner({ status, again, is_recording }) {
  const [is_told, set_told] = useState(false);
  const is_lost = status.is === "lost";
  useEffect(() => {
    if (!is_lost) return set_told(false);
    const timer = setTimeout(() => set_told(true), QUIET_MS);
    return () => clearTimeout(timer);
  }, [is_lost]);
  return html`<div role="status">
    ${is_lost && is_told && html`<div class="banner bad">
      <span>No connection to the desk. ${is_recording
        ? "A recording goes on without this page."
        : "Is the desk running on its computer?"} Trying again …</span>
      <button type="button" onClick=${again}>Try now</button>
    </div>`}
  </div>`;
}

/** @param {{problems: import("../desk/requests.js").Problem[]}} properties */
export const DeskProblems = ({ problems }) =>
  problems.map((problem) => html`<div class="banner" key=${problem_words(problem)}><span>${problem_words(problem)}</span></div>`);
