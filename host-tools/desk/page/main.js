/**
 * The desk's page. What is shown follows from the desk's state alone; only what is being typed, and
 * the frames that are drawn, are kept here.
 *
 *     desk/    the connection: its clock, requests, what the desk says
 *     draw/    the frames of a box, and the drawings of them
 *     parts/   elements that several steps share
 *     shell/   what is around the steps
 *     steps/   Print, Boxes, Aim, Calibrate, Scene, Session, Trials, Study
 */

import { Connection } from "./desk/connection.js";
import { LiveFrames } from "./draw/live.js";
import { Shell } from "./shell/shell.js";
import { play, unlock_when_used } from "./sound.js";
import { html, render } from "./vendor/preact-htm.js";

/** What a step gets. */
const live = new LiveFrames();

/** @type {import("./shell/shell.js").Seen} */
let seen = { status: { is: "connecting" }, state: null };

const connection = new Connection({
  status: (status) => show({ status }),
  state: (state) => show({ state }),
  frames: (message) => live.frames(connection, message),
  another: () => live.samples.clear(),
  tone: (message) => {
    if (message.box === live.box) play(TONES[message.tone]);
  },
});

/** The tone for the desk's word. @type {Record<string, keyof typeof import("./sound.js").TONES>} */
const TONES = { count: "tick", start: "start", end: "end", shutter: "done" };

/** @param {Partial<typeof seen>} news */
function show(news) {
  seen = { ...seen, ...news };
  const root = /** @type {HTMLElement} */ (document.getElementById("page"));
  render(html`<${Shell} seen=${seen} connection=${connection} live=${live} />`, root);
}

unlock_when_used();
show({});
void connection.open();
