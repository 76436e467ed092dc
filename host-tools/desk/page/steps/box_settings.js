/** The settings of a box that is there: what it runs with, to be changed and sent. */

import { get, of_box, post } from "../desk/requests.js";
import { Busy, LinkNote, can } from "../parts/box.js";
import { Act, Field, Note } from "../parts/elements.js";
import { CameraFields, ExpertText, NetworkFields, SettingsProblem, WireFields, draft_of, fields_of, useCheckedSettings } from "../parts/settings_form.js";
import { WiresOf } from "../parts/wires.js";
import { address } from "../shell/route.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";

/** @typedef {import("../desk/wire.js").BoxState} BoxState */
/** @typedef {import("../desk/wire.js").Settings} Settings */

/** @param {import("../shell/shell.js").StepProperties} properties */
export function BoxSettings({ box: chosen, connection }) {
  const box = /** @type {BoxState} */ (chosen);
  const [settings, set_settings] = useState(/** @type {Settings | null} */ (null));
  const [error, set_error] = useState("");
  const configuration = box.hello?.configuration;
  useEffect(() => {
    if (!configuration) return;
    get(of_box(box.id, "settings")).then((answer) => (set_error(""), set_settings(answer)), (problem) => set_error(problem.message));
  }, [box.id, configuration]);
  return html`<section tabindex="-1">
    <h1>Settings of ${box.name}</h1>
    <${LinkNote} box=${box} />
    <${Busy} box=${box} connection=${connection} />
    ${error && html`<${Note} verdict="bad" text=${error} />`}
    ${!configuration && html`<p>Its settings are shown once the box is heard.</p>`}
    ${box.health?.wires && html`<article class="card" aria-label="Wires"><h2>Wires to other devices</h2><${WiresOf} wires=${box.health.wires} /></article>`}
    ${settings && html`<${Form} key=${settings.text} box=${box} first=${settings} />`}
    <div class="row"><a class="button" href=${address("boxes", box.id)}>Back to the boxes</a></div>
  </section>`;
}

/** @param {{box: BoxState, first: Settings}} properties */
function Form({ box, first }) {
  const [draft, set_draft] = useState(() => draft_of(first.fields));
  const [text, set_text] = useState(/** @type {string | null} */ (null));
  const settings = text === null ? { fields: fields_of(draft) } : { text };
  const checked = useCheckedSettings(settings);
  const is_as_before = checked.settings?.text === first.text;
  const can_send = can(box, "settings_send");
  return html`<form class="card" aria-label="Settings" onSubmit=${(/** @type {Event} */ event) => event.preventDefault()}>
    ${text === null && html`
      <div class="fields">
        <${Field} label="Name" value=${draft.device} set=${(/** @type {string} */ device) => set_draft({ ...draft, device })} maxlength="24" />
        <${Field} label="Serial number" value=${draft.serial_number} set=${() => {}} readonly hint="it stays: its key is kept by it" />
      </div>
      <${CameraFields} draft=${draft} set=${set_draft} is_new=${false} />
      <${WireFields} draft=${draft} set=${set_draft} />
      <${NetworkFields} draft=${draft} set=${set_draft} />`}
    <${ExpertText} text=${text} first=${checked.settings?.text ?? first.text} set=${set_text} />
    <${SettingsProblem} problem=${checked.problem} />
    <p class="soft">The box restarts with them, and keeps its camera's calibration, its targets and its scene. A box that cannot
      use them says why.</p>
    ${!can_send && html`<p class="soft">${WHY_NOT[box.doing] ?? (box.session ? "A session goes on with this box: close it first." : "The box is busy.")}</p>`}
    <div class="row"><${Act} kind="first" type="submit" act=${() => post(of_box(box.id, "settings/send"), { settings })}
      disabled=${Boolean(checked.problem) || is_as_before} waits=${!can_send}>Send them to the box<//></div>
  </form>`;
}

/** Why they cannot be sent now. @type {Record<string, string>} */
const WHY_NOT = {
  nothing: "The box is not heard.",
  recording: "A trial is being recorded: nothing is changed meanwhile.",
  aiming: "The picture is shown: end that in the step Aim first.",
};
