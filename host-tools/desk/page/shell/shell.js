/** Around the steps: who one works with, the way through the steps, the connection. */

import { LinkWord } from "../parts/box.js";
import { Aim } from "../steps/aim.js";
import { Boxes } from "../steps/boxes.js";
import { BoxSettings } from "../steps/box_settings.js";
import { Calibrate } from "../steps/calibrate.js";
import { Card, NewBox } from "../steps/new_box.js";
import { Print } from "../steps/print.js";
import { Scene } from "../steps/scene.js";
import { Session } from "../steps/session.js";
import { Study } from "../steps/study.js";
import { Trials } from "../steps/trials.js";
import { html, useEffect, useRef } from "../vendor/preact-htm.js";
import { ConnectionBanner, DeskProblems } from "./banner.js";
import { PARTS, STEPS, address, go, name_of, useRoute } from "./route.js";
import { SignIn } from "./sign_in.js";

/** @typedef {import("../desk/wire.js").State} State */
/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/connection.js").Connection} Connection */
/** @typedef {import("../draw/live.js").LiveFrames} LiveFrames */
/** @typedef {{status: import("../desk/connection.js").Status, state: State | null}} Seen */
/** What a step gets. @typedef {{state: State, box: BoxState | null, connection: Connection, live: LiveFrames}} StepProperties */

const COMPONENTS = {
  print: Print, boxes: Boxes, "new-box": NewBox, card: Card, settings: BoxSettings, aim: Aim, calibrate: Calibrate,
  scene: Scene, session: Session, trials: Trials, study: Study,
};

/** Steps in which a box is chosen. */
const OF_A_BOX = ["card", "settings", "aim", "calibrate", "scene", "session"];

/** Parts in which whatever boxes do changes nothing of what is being typed. */
const OF_NO_BOX = ["print", "new-box"];

/** @param {{seen: Seen, connection: Connection, live: LiveFrames}} properties */
export function Shell({ seen: { status, state }, connection, live }) {
  const route = useRoute();
  const box = (state && chosen_box(state, route.box)) ?? null;
  const main = useRef(/** @type {HTMLElement | null} */ (null));
  const is_first = useRef(true);
  useEffect(() => live.watch(connection, box?.id ?? null), [box?.id]);
  useEffect(() => {
    document.title = `${name_of(route.step)} – Plumbline desk`;
    // Whoever goes to another step goes on reading there.
    if (!is_first.current) /** @type {HTMLElement | null} */ (main.current?.querySelector("section"))?.focus();
    is_first.current = false;
  }, [route.step]);
  if (status.is === "sign_in") {
    return html`<main><${SignIn} greeting=${status.greeting} sign_in=${(/** @type {string} */ it) => connection.sign_in(it)} /></main>`;
  }
  const Step = COMPONENTS[/** @type {keyof typeof COMPONENTS} */ (route.step)];
  const needs_box = OF_A_BOX.includes(route.step) && !box;
  return html`
    <a class="skip" href="#main" onClick=${(/** @type {Event} */ event) => {
      event.preventDefault();
      /** @type {HTMLElement | null} */ (main.current?.querySelector("section"))?.focus();
    }}>Skip to the step</a>
    <header class="top">
      <span class="brand">Plumbline</span>
      ${state && html`<${ChosenBox} state=${state} box=${box} step=${route.step} />`}
    </header>
    <${ConnectionBanner} status=${status} again=${() => connection.now()} is_recording=${box?.session?.at.is === "recording"} />
    ${state && html`<${DeskProblems} problems=${state.desk.problems} />`}
    <nav class="steps" aria-label="Steps"><ol>
      ${STEPS.map(([step, name]) => html`<li key=${step}>
        <a href=${address(step, box?.id ?? null)} aria-current=${step === (PARTS[route.step]?.[1] ?? route.step) ? "step" : undefined}>${name}</a>
      </li>`)}
    </ol></nav>
    <main ref=${main} id="main">
      ${!state
        ? html`<section tabindex="-1"><h1>Plumbline desk</h1><p>Connecting …</p></section>`
        : needs_box
          ? html`<section tabindex="-1"><h1>Choose a box</h1>
              <p>This step is done with a box. <a href=${address("boxes", null)}>Choose one</a>.</p></section>`
          : html`<${Step} key=${route.step + (OF_NO_BOX.includes(route.step) ? "" : (box?.id ?? ""))} state=${state} box=${box} connection=${connection} live=${live} />`}
    </main>`;
}

/** The box of the address; otherwise the first that is here. @param {State} state @param {string | null} id */
function chosen_box(state, id) {
  const named = state.boxes.find((box) => box.id === id);
  return named ?? state.boxes.find((box) => box.link.is === "heard") ?? state.boxes[0];
}

/** @param {{state: State, box: BoxState | null, step: string}} properties */
function ChosenBox({ state, box, step }) {
  if (!box) return html`<span class="chosen soft">No box</span>`;
  const choose = (/** @type {Event} */ event) => go(step, /** @type {HTMLSelectElement} */ (event.target).value);
  return html`<div class="chosen">
    ${state.boxes.length > 1
      ? html`<select aria-label="Box" value=${box.id} onChange=${choose}>
          ${state.boxes.map((it) => html`<option key=${it.id} value=${it.id} selected=${it.id === box.id}>${it.name}</option>`)}
        </select>`
      : html`<strong>${box.name}</strong>`}
    <${LinkWord} box=${box} />
  </div>`;
}
