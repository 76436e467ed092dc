/** What the desk says of what is being typed. */

import { post } from "../desk/requests.js";
import { useEffect, useState } from "../vendor/preact-htm.js";

/** It is asked when nothing has been typed for so long. */
const QUIET_MS = 400;

/**
 * The desk's answer to the latest that was typed; its `problem` is the first fault.
 *
 * @template T
 * @param {string} path The route that checks it.
 * @param {T} draft What is being typed.
 * @param {(draft: T) => object} body_of What is sent of it; throws what cannot be read.
 * @returns {any}
 */
export function useChecked(path, draft, body_of) {
  const [checked, set_checked] = useState(/** @type {any} */ ({ problem: null }));
  useEffect(() => {
    let is_wanted = true;
    const check = async () => {
      let answer;
      try {
        answer = await post(path, body_of(draft));
      } catch (error) {
        answer = { problem: { place: "", found: error instanceof Error ? error.message : String(error), remedy: "" } };
      }
      if (is_wanted) set_checked(answer);
    };
    const timer = setTimeout(() => void check(), QUIET_MS);
    return () => {
      is_wanted = false;
      clearTimeout(timer);
    };
  }, [JSON.stringify(draft)]);
  return checked;
}
