/** What several steps show of a box: its link, what it is busy with, how that failed, what happened. */

import { of_box, post, problem_words } from "../desk/requests.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";
import { clock } from "../words.js";
import { Act, Note, Word } from "./elements.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/connection.js").Connection} Connection */

/** @param {BoxState} box @param {string} action As the desk names it. */
export const can = (box, action) => box.can.includes(action);

/** @param {{box: BoxState}} properties */
export function LinkWord({ box }) {
  const words = { heard: ["good", "connected"], silent: ["bad", "silent"], searching: ["none", "not heard"] };
  const [verdict, word] = words[box.link.is];
  return html`<${Word} verdict=${verdict}>${word}<//>`;
}

/** Why the box is not there. @param {{box: BoxState}} properties */
export function LinkNote({ box }) {
  const { problem } = box.link;
  return problem && html`<${Note} verdict=${box.link.is === "silent" ? "bad" : "warn"} text=${problem.found} remedy=${problem.remedy} />`;
}

/**
 * A button for an action of a box; it is there only if the action is possible now.
 *
 * @param {{box: BoxState, needs: string, action: string, body?: object | (() => object), stays?: boolean, children?: unknown}} properties
 *   `needs` is the desk's name of the action, `action` the end of its route; a `body` that is a function is
 *   asked when the button is pressed, and may throw what is wrong. One that `stays` waits
 *   where it is until the action is possible again.
 */
export function BoxAct({ box, needs, action, body, stays = false, children, ...others }) {
  const is_possible = can(box, needs);
  if (!is_possible && !stays) return null;
  return html`<${Act} waits=${!is_possible} act=${() => post(of_box(box.id, action), typeof body === "function" ? body() : body)} ...${others}>${children}<//>`;
}

/** The desk's clock, ms, at this moment and then again every so often. @param {Connection} connection @param {number} every_ms */
export function useDeskNow(connection, every_ms = 200) {
  const [, set_count] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => set_count((count) => count + 1), every_ms);
    return () => clearInterval(timer);
  }, [every_ms]);
  return connection.clock.now_ms();
}

/** What takes long, and how the latest of it failed. @param {{box: BoxState, connection: Connection}} properties */
export function Busy({ box, connection }) {
  return html`
    ${box.job && html`<${Working} job=${box.job} connection=${connection} />`}
    ${box.failed && html`<div role="alert"><${Note} verdict="bad" text=${problem_words({ ...box.failed, remedy: "" })} remedy=${box.failed.remedy} /></div>`}`;
}

/** @param {{job: NonNullable<BoxState["job"]>, connection: Connection}} properties */
function Working({ job, connection }) {
  const since_s = (useDeskNow(connection) - job.since_at_ms) / 1000;
  return html`<div class="card" role="status">
    <div class="row apart"><strong>${job.words}</strong><span class="soft" aria-hidden="true">${clock(since_s)}</span></div>
    <progress max="1" value=${job.share ?? undefined} aria-label=${job.words}></progress>
  </div>`;
}

/** What happened with a box, the latest first. @param {{box: BoxState, most: number}} properties */
export function Notices({ box, most }) {
  const latest = box.notices.slice(-most).reverse();
  return latest.length > 0 && html`<ul class="list small">
    ${latest.map((notice) => html`<li key=${notice.at_ms + notice.words} class=${notice.is_warning ? "note warn" : "soft"}>${notice.words}</li>`)}
  </ul>`;
}
