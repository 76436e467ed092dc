/** Where on the page one is: the step and the box, in the address behind `#`, so that a reload stays there. */

import { useEffect, useState } from "../vendor/preact-htm.js";

/** The steps in the order in which one goes through them. @type {[string, string][]} */
export const STEPS = [
  ["print", "Print"],
  ["boxes", "Boxes"],
  ["aim", "Aim"],
  ["calibrate", "Calibrate"],
  ["scene", "Scene"],
  ["session", "Session"],
  ["trials", "Trials"],
  ["study", "Study"],
];

/** What belongs to a step and has an address of its own: its name, and that step. @type {Record<string, [string, string]>} */
export const PARTS = { "new-box": ["A new box", "boxes"], card: ["The card", "boxes"], settings: ["Settings", "boxes"] };

/** The words for a step, or for a part of one. @param {string} step */
export const name_of = (step) => PARTS[step]?.[0] ?? STEPS.find(([name]) => name === step)?.[1];

/** @typedef {{step: string, box: string | null}} Route */

/** @returns {Route} */
function read() {
  const [step, box] = location.hash.slice(1).split("/");
  const is_known = Object.hasOwn(PARTS, step) || STEPS.some(([name]) => name === step);
  let decoded = null;
  try {
    decoded = box ? decodeURIComponent(box) : null;
  } catch {
    // An address that somebody has mistyped.
  }
  return { step: is_known ? step : "boxes", box: decoded };
}

/** @param {string} step @param {string | null} box */
export const address = (step, box) => `#${step}${box ? `/${encodeURIComponent(box)}` : ""}`;

/** @param {string} step @param {string | null} box */
export function go(step, box) {
  location.hash = address(step, box);
}

export function useRoute() {
  const [route, set_route] = useState(read());
  useEffect(() => {
    const changed = () => set_route(read());
    addEventListener("hashchange", changed);
    return () => removeEventListener("hashchange", changed);
  }, []);
  return route;
}
