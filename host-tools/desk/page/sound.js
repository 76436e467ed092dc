/**
 * The tones that a participant, or whoever holds the board, hears. A browser plays none before the
 * page has been clicked or a key pressed, so the page says whether tones can be heard.
 */

/** A tone: its pitches, Hz, one after the other, and how long each lasts, s. @typedef {{pitches: number[], each_s: number}} Tone */

/** @type {Record<"start" | "end" | "tick" | "done", Tone>} */
export const TONES = {
  /** The trial begins. */
  start: { pitches: [880], each_s: 0.5 },
  /** The trial has lasted as long as it should. */
  end: { pitches: [660, 440], each_s: 0.4 },
  /** A second of a countdown. */
  tick: { pitches: [587], each_s: 0.09 },
  /** A photograph has been taken. */
  done: { pitches: [784, 1047], each_s: 0.12 },
};

const LOUDNESS = 0.35;
/** How fast a tone swells and fades: without it one hears clicks. */
const EDGE_S = 0.015;

/** @type {AudioContext | undefined} */
let audio;

/** Whether tones can be heard. */
export const can_be_heard = () => audio?.state === "running";

/** Makes tones possible; a browser allows it only in answer to a click or a key. */
export async function unlock() {
  try {
    audio ??= new AudioContext();
    if (audio.state !== "running") await audio.resume();
  } catch {
    // Without a sound card there are no tones; the page shows everything, too.
  }
}

/** Asks for sound whenever somebody does something on the page. */
export function unlock_when_used() {
  for (const name of ["pointerdown", "keydown"]) addEventListener(name, () => void unlock(), { passive: true });
}

/** @param {keyof typeof TONES} name */
export function play(name) {
  const out = audio;
  if (!out || !can_be_heard()) return;
  const { pitches, each_s } = TONES[name];
  pitches.forEach((pitch, index) => {
    const [begin, end] = [out.currentTime + index * each_s, out.currentTime + (index + 1) * each_s];
    const [source, volume] = [out.createOscillator(), out.createGain()];
    source.frequency.value = pitch;
    volume.gain.setValueAtTime(0, begin);
    volume.gain.linearRampToValueAtTime(LOUDNESS, begin + EDGE_S);
    volume.gain.setValueAtTime(LOUDNESS, end - EDGE_S);
    volume.gain.linearRampToValueAtTime(0, end);
    source.connect(volume).connect(out.destination);
    source.start(begin);
    source.stop(end);
  });
}
