/**
 * The settings of a box as fields: what its camera does, where it sends to, its wires. The desk checks
 * them while one types; experts have the whole text.
 */

import { problem_words } from "../desk/requests.js";
import { html } from "../vendor/preact-htm.js";
import { number_or_text } from "../words.js";
import { useChecked } from "./checked.js";
import { Choice, Field, Note, Tick } from "./elements.js";

/** The fields of box.toml, as the desk has them. @typedef {Record<string, any>} Fields */
/** Fields as they are typed; numbers are texts. @typedef {Record<string, any>} Draft */
/** What the desk reads. @typedef {{fields: Fields} | {text: string}} Settings */

/** @type {[string, string][]} */
const DRIVERS = [["v4l2", "USB (v4l2)"], ["libcamera", "ribbon cable (libcamera)"]];
/** @type {[string, string][]} */
const FORMATS = ["grey", "y10", "y16", "yuyv", "nv12", "rgb24", "bayer8", "mjpeg"].map((it) => [it, it]);
/** @type {[string, string][]} */
const NETWORKS = [["dhcp", "by itself (DHCP)"], ["fixed", "a fixed one"]];
/** @type {[string, string][]} */
const EDGES = [["rising", "when it rises"], ["falling", "when it falls"], ["both", "both"]];
/** @type {[string, string][]} */
const MARKED = [["exposures", "each frame"], ["recording", "a trial"]];

/** The kernel's label for the lines of a Raspberry Pi. */
const CHIP = "pinctrl-bcm2711";

/** @param {Fields} fields @returns {Draft} */
export const draft_of = (fields) => ({
  ...structuredClone(fields),
  capture: { driver: "v4l2", pixel_format: "grey", ...fields.capture },
  links: { ...fields.links },
  network: { is: fields.network ? "fixed" : "dhcp", address: "", gateway: "", ...fields.network },
  trigger: { has_some: Boolean(fields.trigger), chip: CHIP, edge: "rising", output_marks: "exposures", ...fields.trigger },
});

/** @param {unknown} typed */
const words = (typed) => String(typed ?? "").trim() || null;

/** @param {Draft} draft @returns {Fields} */
export function fields_of({ capture, links, network, trigger, ...draft }) {
  return {
    ...draft,
    device: String(draft.device ?? "").trim(),
    serial_number: String(draft.serial_number ?? "").trim(),
    capture: { ...capture, rate_hz: number_or_text(capture.rate_hz), exposure_us: number_or_text(capture.exposure_us), gain: number_or_text(capture.gain) },
    links: { ...links, udp: words(links.udp) },
    network: network.is === "fixed" ? { address: String(network.address).trim(), gateway: words(network.gateway) } : null,
    trigger: trigger.has_some
      ? {
          chip: String(trigger.chip).trim(),
          line: number_or_text(trigger.line),
          edge: trigger.edge,
          debounce_us: number_or_text(trigger.debounce_us) ?? 0,
          output_line: number_or_text(trigger.output_line),
          output_marks: trigger.output_marks,
        }
      : null,
  };
}

/** What the desk says of settings: their text, or their first fault. @param {Settings} settings @returns {import("../desk/wire.js").SettingsChecked} */
export const useCheckedSettings = (settings) => useChecked("/api/settings/check", settings, (it) => ({ settings: it }));

/** @param {{problem: import("../desk/requests.js").Problem | null}} properties */
export const SettingsProblem = ({ problem }) => html`<div aria-live="polite">
  ${problem && html`<${Note} verdict="warn" text=${problem_words({ ...problem, remedy: "" })} remedy=${problem.remedy} />`}
</div>`;

/** @typedef {{draft: Draft, set: (draft: Draft) => void}} Part */

/** Writes one field of one table. @param {Part} part @param {string} table */
const setter = ({ draft, set }, table) => (/** @type {string} */ name) => (/** @type {unknown} */ value) =>
  set({ ...draft, [table]: { ...draft[table], [name]: value } });

/** @param {Part & {is_new: boolean}} properties */
export function CameraFields({ draft, set, is_new }) {
  const of = setter({ draft, set }, "capture");
  const { capture } = draft;
  return html`<fieldset>
    <legend>Camera</legend>
    <div class="fields">
      ${is_new && html`
        <${Choice} label="Kind" value=${capture.driver} set=${of("driver")} choices=${DRIVERS} />
        <${Choice} label="Format of its pixels" value=${capture.pixel_format} set=${of("pixel_format")} choices=${FORMATS} />`}
      <${Field} label="Frames per second" value=${capture.rate_hz} set=${of("rate_hz")} inputmode="decimal" />
      ${!is_new && html`
        <${Field} label="Exposure, µs" value=${capture.exposure_us} set=${of("exposure_us")} inputmode="numeric" hint="empty: as the camera has it" />
        <${Field} label="Gain" value=${capture.gain} set=${of("gain")} inputmode="decimal" hint="empty: as the camera has it" />`}
    </div>
  </fieldset>`;
}

/** @param {Part & {addresses?: string[]}} properties */
export function NetworkFields({ draft, set, addresses = [] }) {
  const of_links = setter({ draft, set }, "links");
  const of = setter({ draft, set }, "network");
  const { links, network } = draft;
  const others = addresses.filter((it) => it !== links.udp);
  const hint = addresses.includes(links.udp) ? "this computer" : "HOST:PORT; left empty, it has no network";
  return html`<fieldset>
    <legend>Network</legend>
    <div class="fields">
      <${Field} label="It sends to" value=${links.udp} set=${of_links("udp")} spellcheck="false" hint=${hint} />
      <${Choice} label="Its own address" value=${network.is} set=${of("is")} choices=${NETWORKS} />
      ${network.is === "fixed" && html`
        <${Field} label="Address and prefix" value=${network.address} set=${of("address")} spellcheck="false" hint="such as 192.168.1.30/24" />
        <${Field} label="Router" value=${network.gateway} set=${of("gateway")} spellcheck="false" hint="may be left empty" />`}
    </div>
    ${others.length > 0 && html`<div class="row"><span class="soft small">This computer is also:</span>
      ${others.map((it) => html`<button type="button" key=${it} onClick=${() => of_links("udp")(it)}>${it}</button>`)}</div>`}
  </fieldset>`;
}

/** The wires to other devices. @param {Part} properties */
export function WireFields({ draft, set }) {
  const of = setter({ draft, set }, "trigger");
  const { trigger } = draft;
  return html`<fieldset>
    <legend>Wires to other devices</legend>
    <${Tick} label="This box has wires" value=${trigger.has_some} set=${of("has_some")} />
    ${trigger.has_some && html`<div class="fields">
      <${Field} label="GPIO chip" value=${trigger.chip} set=${of("chip")} spellcheck="false" hint="its label, or a device" />
      <${Field} label="Line for marks" value=${trigger.line} set=${of("line")} inputmode="numeric" hint="3.3 V at most; empty: none" />
      <${Choice} label="A mark" value=${trigger.edge} set=${of("edge")} choices=${EDGES} />
      <${Field} label="Rest after an edge, µs" value=${trigger.debounce_us ?? 0} set=${of("debounce_us")} inputmode="numeric" hint="for a push button, 5000" />
      <${Field} label="Output line" value=${trigger.output_line} set=${of("output_line")} inputmode="numeric" hint="a pulse for each frame, or high during a trial; empty: none" />
      <${Choice} label="It tells of" value=${trigger.output_marks} set=${of("output_marks")} choices=${MARKED} />
    </div>`}
  </fieldset>`;
}

/**
 * The fields, or the whole text; what is chosen last counts.
 *
 * @param {{text: string | null, first: string, set: (text: string | null) => void}} properties
 *   `first` is the text to begin with; `text` is `null` while the fields count.
 */
export function ExpertText({ text, first, set }) {
  return html`<div class="stack">
    <${Tick} label="For experts: every setting as text (box.toml)" value=${text !== null} set=${(/** @type {boolean} */ is_text) => set(is_text ? first : null)} />
    ${text !== null && html`<${Field} label="box.toml" value=${text} set=${set} kind="textarea" rows="22" spellcheck="false" class="code" whole />`}
  </div>`;
}
