/** Session: it is set up, or it goes on. */

import { Busy, LinkNote } from "../parts/box.js";
import { useStudies } from "../parts/study.js";
import { html } from "../vendor/preact-htm.js";
import { Prepare } from "./prepare.js";
import { Run } from "./run.js";

/** @param {import("../shell/shell.js").StepProperties} properties */
export function Session({ state, box: chosen, connection, live }) {
  const box = /** @type {import("../desk/wire.js").BoxState} */ (chosen);
  const studies = useStudies(state);
  return html`<section tabindex="-1">
    <${LinkNote} box=${box} />
    ${box.session
      ? html`<${Run} box=${box} session=${box.session} connection=${connection} live=${live} />`
      : html`<${Prepare} box=${box} studies=${studies} live=${live} />`}
    <${Busy} box=${box} connection=${connection} />
  </section>`;
}
