/** Scene: the board stands where the person will stand, and says which way is forward. */

import { BoxAct, Busy, LinkNote } from "../parts/box.js";
import { Facts, Field, Note } from "../parts/elements.js";
import { address } from "../shell/route.js";
import { html, useState } from "../vendor/preact-htm.js";
import { number, typed_number } from "../words.js";

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Scene({ box: chosen, connection }) {
  const box = /** @type {import("../desk/wire.js").BoxState} */ (chosen);
  const [pitch, set_pitch] = useState("");
  const { scene } = box;
  const looks_down = () => ({ camera_pitch_deg: typed_number(pitch, "Down by, degrees") });
  return html`<section tabindex="-1">
    <h1>Measure the scene</h1>
    <p class="sentence">${scene?.is_stored
      ? "From now on nobody touches the camera."
      : "Stand the board upright where the person will stand, facing the camera."}</p>
    <${LinkNote} box=${box} />
    <${Busy} box=${box} connection=${connection} />
    <details>
      <summary>The camera looks down or up</summary>
      <${Field} label="Down by, degrees, where it was measured" value=${pitch} set=${set_pitch} inputmode="decimal" />
    </details>
    <div class="row">
      <${BoxAct} box=${box} needs="scene_measure" action="scene/measure" body=${looks_down} kind=${scene ? "" : "first"} stays=${box.doing === "measuring_scene"}>
        ${scene ? "Measure again" : "Measure"}<//>
    </div>
    ${scene && html`<article class="card" aria-label="The scene">
      <h2>${scene.is_stored ? "The box has this scene" : "The scene"}</h2>
      <p>${scene.words}</p>
      <${Facts} facts=${[
        ["The board leans by", number(scene.leans_deg, 2, "°")],
        ["A frame varies by", number(scene.spread_deg, 3, "°")],
        ["and by", number(scene.spread_mm, 3, "mm")],
      ]} />
      ${scene.warnings.map((words) => html`<${Note} key=${words} verdict="warn" text=${words} />`)}
      <div class="row">
        ${!scene.is_stored && html`<${BoxAct} box=${box} needs="scene_store" action="scene/store" kind="first">Keep it in the box<//>`}
        ${scene.is_stored && html`<a class="button" href=${address("session", box.id)}>Go on to a session</a>`}
      </div>
    </article>`}
  </section>`;
}
