/**
 * Aim: the live picture, how sharp, bright and large each target is, and the next thing to do in one
 * sentence that whoever turns the lens or holds the board can read.
 */

import { BoxAct, Busy, LinkNote, can, useDeskNow } from "../parts/box.js";
import { Act, Meter, Note, Word } from "../parts/elements.js";
import { Picture } from "../parts/picture.js";
import { address } from "../shell/route.js";
import { html, useRef } from "../vendor/preact-htm.js";
import { clock, number } from "../words.js";

/** @typedef {import("../desk/wire.js").AimTarget} AimTarget */

/** A bar of sizes ends here. */
const PITCH_PX_MOST = 45;

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Aim({ box: chosen, connection }) {
  const box = /** @type {import("../desk/wire.js").BoxState} */ (chosen);
  const { aim } = box;
  const frame = useRef(/** @type {HTMLElement | null} */ (null));
  const to_full_screen = () => (document.fullscreenElement ? document.exitFullscreen() : frame.current?.requestFullscreen());
  return html`<section tabindex="-1">
    <div class="row apart">
      <h1>Aim the camera</h1>
      <div class="row">
        <${BoxAct} box=${box} needs="aim_begin" action="aim/begin" kind="first" focus>Show the picture<//>
        ${aim && html`<${Act} act=${to_full_screen}>Full screen<//>`}
        <${BoxAct} box=${box} needs="aim_expose" action="aim/expose" body=${{ store: true }}>Find the exposure and keep it<//>
        <${BoxAct} box=${box} needs="aim_cancel" action="aim/cancel">Stop the search<//>
        <${BoxAct} box=${box} needs="aim_end" action="aim/end">End<//>
      </div>
    </div>
    <${LinkNote} box=${box} />
    <${Busy} box=${box} connection=${connection} />
    ${!aim && html`<p>The picture leaves the box only while it is shown here. Choose the frame so that the whole person
      fits, with the targets as large as that allows; turn the lens until the focus is highest, and lock it.</p>`}
    ${aim && html`
      <div class="aim columns wide-left" ref=${frame}>
        <div class="stack">
          <p class="sentence ${aim.is_good ? "note good" : ""}" aria-live="polite">${aim.next}</p>
          <${Picture} box=${box.id} aim=${aim} />
        </div>
        <div class="stack">
          ${aim.targets.map((target) => html`<${Target} key=${target.name} target=${target} enough=${aim.enough} />`)}
          ${aim.frame && html`<p class="soft">${aim.frame}</p>`}
          ${aim.frame_advice.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
          <${Exposure} aim=${aim} />
          <${EndsBySelf} aim=${aim} connection=${connection} />
        </div>
      </div>
      <div class="row">
        <a class="button" href=${address("calibrate", box.id)}>Go on to calibrate</a>
        ${!can(box, "aim_end") && html`<span class="soft">The box is busy.</span>`}
      </div>`}
  </section>`;
}

/** @param {{target: AimTarget, enough: import("../desk/wire.js").AimEnough}} properties */
function Target({ target, enough }) {
  const { focus, focus_best, light, contrast, pitch_px } = target;
  const is_enough = (/** @type {number} */ value, /** @type {number} */ least) => (value >= least ? "good" : "warn");
  return html`<article class="card" aria-label=${target.name}>
    <div class="row apart"><h2>${target.name}</h2>
      <${Word} verdict=${target.is_found ? "good" : "none"}>${target.state}<//></div>
    ${focus !== null && html`<${Meter} label="Focus" words=${`${focus} of 100, best ${focus_best}`} value=${focus} most=${100}
      mark=${focus_best ?? undefined} verdict=${is_enough(focus, enough.focus)} />`}
    ${light !== null && html`<${Meter} label="Light" words=${number(light, 2)} value=${light} most=${1} verdict=${is_enough(light, enough.light)} />`}
    ${contrast !== null && html`<${Meter} label="Contrast" words=${number(contrast, 2)} value=${contrast} most=${1} verdict=${is_enough(contrast, enough.contrast)} />`}
    ${pitch_px !== null && html`<${Meter} label="Size of a square" words=${number(pitch_px, 0, "px")} value=${pitch_px} most=${PITCH_PX_MOST}
      mark=${enough.pitch_px} verdict=${is_enough(pitch_px, enough.pitch_px)} />`}
    ${target.advice.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
    ${focus === null && target.numbers.length > 0 && html`<p class="soft">${target.numbers.join(", ")}</p>`}
  </article>`;
}

/** @param {{aim: import("../desk/wire.js").Aim}} properties */
function Exposure({ aim }) {
  const { exposure, exposure_us, gain } = aim;
  const now = [exposure_us !== null && `exposed for ${number(exposure_us / 1000, 1)} ms`, gain !== null && `gain ${number(gain, 1)}`];
  return html`
    ${now.some(Boolean) && html`<p class="soft">${now.filter(Boolean).join(", ")}</p>`}
    ${exposure && html`<div class="card" role="status">
      <h2>Exposure</h2>
      <ul class="list small">${exposure.tried.map((words, index) => html`<li key=${index}>${words}</li>`)}</ul>
      ${exposure.found ? html`<p><strong>${exposure.found}</strong></p>` : exposure.is_running && html`<p>Searching …</p>`}
    </div>`}`;
}

/** @param {{aim: import("../desk/wire.js").Aim, connection: import("../desk/connection.js").Connection}} properties */
function EndsBySelf({ aim, connection }) {
  const left_s = (aim.ends_at_ms - useDeskNow(connection, 1000)) / 1000;
  return html`<p class="soft">So that no page left open keeps a room in view, the picture ends by itself in ${clock(left_s)}.</p>`;
}
