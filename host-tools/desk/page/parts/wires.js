/** The wires of a box to other devices: whether they can be used, and what has come over them. */

import { html } from "../vendor/preact-htm.js";
import { counted } from "../words.js";
import { Note, Word } from "./elements.js";

/** @typedef {import("../desk/wire.js").Wires} Wires */

/** @param {{wires: Wires}} properties */
export function WiresOf({ wires }) {
  const { input, output, sent, bounces, dropped, pulses } = wires;
  const is_missing = [input, output].includes("missing");
  return html`<div class="stack" role="group" aria-label="Wires to other devices">
    ${input !== "off" && html`<div class="row">
      <span>Line for marks</span><${OneWire} wire=${input} />
      ${input === "ready" && html`<span class="soft">${counted(sent, "mark")} since its start, ${counted(bounces, "bounce")} left out</span>`}
    </div>`}
    ${output !== "off" && html`<div class="row">
      <span>Output line</span><${OneWire} wire=${output} />
      ${output === "ready" && html`<span class="soft">${counted(pulses, "pulse")} given</span>`}
    </div>`}
    ${is_missing && html`<${Note} verdict="bad" text="A wire cannot be used."
      remedy="Look at the chip and the number of the line in the box's settings, and that nothing else uses it." />`}
    ${dropped > 0 && html`<${Note} verdict="warn" text=${`${counted(dropped, "edge")} came faster than the box reads them, and ${dropped === 1 ? "is" : "are"} lost.`}
      remedy="Look at the wire and its ground; give a rest after an edge for a contact that bounces." />`}
  </div>`;
}

/** @param {{wire: "off" | "ready" | "missing"}} properties */
const OneWire = ({ wire }) => html`<${Word} verdict=${wire === "ready" ? "good" : "bad"}>${wire}<//>`;
