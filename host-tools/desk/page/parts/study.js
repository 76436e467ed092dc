/** The study that is worked with: which one, and what is in it, fetched again whenever it has changed. */

import { get, of_study } from "../desk/requests.js";
import { html, useEffect, useState } from "../vendor/preact-htm.js";
import { Choice, Note } from "./elements.js";

/** @typedef {import("../desk/wire.js").State} State */
/** @typedef {import("../desk/wire.js").Study} Study */

/** Under this name the browser keeps the choice until its window is closed. */
const KEPT = "study";

/**
 * @typedef {object} Studies
 * @property {{folder: string, title: string, problem: import("../desk/requests.js").Problem | null}[] | null} list
 * @property {Study | null} study The chosen one.
 * @property {string} error Why it could not be fetched.
 * @property {(folder: string) => void} choose
 * @property {(study: Study) => void} replace What a request has answered is newer than what is here.
 */

/** @param {State} state @returns {Studies} */
export function useStudies(state) {
  const [list, set_list] = useState(/** @type {Studies["list"]} */ (null));
  const [study, set_study] = useState(/** @type {Study | null} */ (null));
  const [error, set_error] = useState("");
  const [kept, set_kept] = useState(sessionStorage.getItem(KEPT));
  const version = state.desk.studies_version;
  const is_there = (/** @type {string | null} */ folder) => list?.some((it) => it.folder === folder);
  const chosen = [kept, state.desk.latest_study, list?.[0]?.folder ?? null].find(is_there) ?? null;

  useFetched("/api/studies", [version], (answer) => set_list(answer.list), set_error);
  useFetched(chosen && of_study(chosen), [version, chosen], set_study, set_error);
  const choose = (/** @type {string} */ folder) => {
    sessionStorage.setItem(KEPT, folder);
    set_kept(folder);
  };
  const replace = (/** @type {Study} */ newer) => {
    choose(newer.folder);
    set_study(newer);
  };
  return { list, study: study?.folder === chosen ? study : null, error, choose, replace };
}

/** @param {string | null} path @param {unknown[]} again @param {(answer: any) => void} take @param {(error: string) => void} fail */
function useFetched(path, again, take, fail) {
  useEffect(() => {
    if (!path) return;
    let is_wanted = true;
    get(path).then(
      (answer) => {
        if (!is_wanted) return;
        fail("");
        take(answer);
      },
      (problem) => is_wanted && fail(problem.message),
    );
    return () => {
      is_wanted = false;
    };
  }, again);
}

/** @param {{studies: Studies}} properties */
export function ChooseStudy({ studies }) {
  const { list, study, error, choose } = studies;
  if (!list || list.length === 0) return error && html`<${Note} verdict="bad" text=${error} />`;
  return html`<div class="stack">
    <${Choice} label="Study" value=${study?.folder ?? ""} set=${choose} choices=${list.map((it) => [it.folder, it.title])} />
    ${error && html`<${Note} verdict="bad" text=${error} />`}
  </div>`;
}
