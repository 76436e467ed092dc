/**
 * What the desk says, as far as this page reads it. `host-tools/desk/src/wire` is the definition.
 *
 * @typedef {import("./requests.js").Problem} Problem
 *
 * @typedef {{words: string, remedy: string}} Reason
 * @typedef {{subject: string, verdict: "skipped" | "good" | "warn" | "fail", seen: string, remedy: string}} Check
 * @typedef {"good" | "doubtful" | "unusable"} Grade
 *
 * @typedef {object} Trunk
 * @property {string} missing
 * @property {FiguresSoFar | null} figures
 * @property {string} not_yet
 *
 * @typedef {object} FiguresSoFar
 * @property {number} path_mm
 * @property {number | null} noise_path_mm
 * @property {[number, number, number]} rms_mm AP, ML and SI.
 * @property {number} gaps
 * @property {number} span_s
 *
 * @typedef {object} Live
 * @property {number} rate_hz
 * @property {number} frames
 * @property {number} lost
 * @property {number | null} arrival_ms
 * @property {number | null} clock_error_ms
 * @property {[number, number] | null} screen_ms
 * @property {"wait" | "good" | "look" | "stop" | null} judgement
 * @property {Reason[]} reasons
 * @property {Trunk} upper
 * @property {Trunk} lower
 * @property {string} time
 * @property {string[]} counts
 *
 * @typedef {object} AimTarget
 * @property {string} name
 * @property {string} state
 * @property {boolean} is_found
 * @property {number | null} focus
 * @property {number | null} focus_best
 * @property {number | null} light
 * @property {number | null} contrast
 * @property {number | null} pitch_px
 * @property {string[]} numbers
 * @property {string[]} advice
 *
 * @typedef {{focus: number, light: number, contrast: number, pitch_px: number}} AimEnough
 *
 * @typedef {object} Aim
 * @property {number} picture
 * @property {[number, number]} picture_px
 * @property {string} next
 * @property {boolean} is_good
 * @property {string} frame
 * @property {string[]} frame_advice
 * @property {AimTarget[]} targets
 * @property {AimEnough} enough
 * @property {number | null} silent_since_at_ms
 * @property {number | null} exposure_us
 * @property {number | null} gain
 * @property {{is_running: boolean, tried: string[], found: string | null} | null} exposure
 * @property {number} ends_at_ms
 *
 * @typedef {{number: number, file: string, is_found: boolean, words: string, error_px: number | null}} Photograph
 *
 * @typedef {object} Photographs
 * @property {[number, number]} board
 * @property {number} pitch_mm
 * @property {string} folder
 * @property {Photograph[]} list
 * @property {[number, number]} cells
 * @property {number[][]} covered
 * @property {number} share
 * @property {string} next
 * @property {number | null} next_at_ms
 * @property {number} to_go
 * @property {number | null} arriving
 *
 * @typedef {object} Calibration
 * @property {boolean} is_good
 * @property {string[]} concerns
 * @property {number} error_px
 * @property {number} used
 * @property {number} photographs
 * @property {string} model
 * @property {string[]} numbers
 * @property {string} file
 * @property {boolean} is_delivered
 *
 * @typedef {object} Scene
 * @property {string} words
 * @property {string[]} warnings
 * @property {number} leans_deg
 * @property {number} spread_deg
 * @property {number} spread_mm
 * @property {boolean} is_stored
 *
 * @typedef {object} Trial
 * @property {string} folder
 * @property {number} place
 * @property {string} condition
 * @property {"open" | "accepted" | "rejected" | "nothing"} outcome
 * @property {string | null} why
 * @property {Grade | null} grade
 * @property {boolean} has_report
 *
 * @typedef {object} Condition
 * @property {string} name
 * @property {string} label
 * @property {string} instruction
 * @property {number} baseline_s
 * @property {number} duration_s
 * @property {"mark" | "start" | "onset"} zero
 *
 * @typedef {object} Session
 * @property {string} study
 * @property {string} title
 * @property {string} name
 * @property {string} participant
 * @property {string | null} operator
 * @property {number} step
 * @property {{is: string, place?: number, until_at_ms?: number, begun_at_ms?: number, first_frame_at_ms?: number | null, zero_at_ms?: number | null, mark_due_at_ms?: number | null, ends_at_ms?: number | null, trial?: string, grade?: Grade, is_zeroed?: boolean, ended?: string, reasons?: Reason[], needs_reason?: boolean}} at
 * @property {string[]} can
 * @property {{place: number, condition: string, label: string, repeat: number, status: string, why: string | null}[]} plan
 * @property {Trial[]} trials
 * @property {Condition | null} condition
 * @property {string[]} marks
 * @property {{at_ms: number, label: string, source: string}[]} marked
 * @property {string[]} warnings
 *
 * @typedef {{number: number, upper: number[] | null, lower: number[] | null}} Reference
 *
 * @typedef {"off" | "ready" | "missing"} Wire
 * @typedef {{input: Wire, output: Wire, sent: number, bounces: number, dropped: number, pulses: number}} Wires
 *
 * @typedef {{text: string, fields: Record<string, any>}} Settings
 * @typedef {{settings: Settings | null, problem: Problem | null}} SettingsChecked
 * @typedef {{settings: Settings, size_px: [number, number], addresses: string[]}} NewBoxForm
 * @typedef {{settings: Settings, size_px: [number, number], folder: string}} Card
 *
 * @typedef {{word: string, title: string, pitch_mm: number, pages: [number, number]}} Sheet
 * @typedef {{name: string, role: string, size: [number, number], pitch_mm: number | null}} PrintedTarget
 * @typedef {{path: string, text: string, targets: PrintedTarget[], warnings: string[], sheets: Sheet[]}} Prints
 *
 * @typedef {object} BoxState
 * @property {string} id
 * @property {string} name
 * @property {string | null} serial_number
 * @property {boolean} has_card
 * @property {{is: "searching" | "heard" | "silent", by?: string, since_at_ms?: number, problem?: Problem}} link
 * @property {{device: string, serial_number: string, firmware: string, configuration: string, size_px: [number, number], asked_hz: number | null, targets: {name: string, role: string, corners: number}[], is_calibrated: boolean | null, has_scene: boolean | null, next: string, next_step: "calibrate" | "scene" | "session"} | null} hello
 * @property {{camera: string, temperature_c: number | null, uptime_s: number, warnings: string[], wires: Wires | null} | null} health
 * @property {string} doing
 * @property {{words: string, since_at_ms: number, share: number | null} | null} job
 * @property {Problem | null} failed
 * @property {string[]} can
 * @property {{at_ms: number, is_warning: boolean, words: string}[]} notices
 * @property {{at_ms: number, worst: string, checks: Check[]} | null} examination
 * @property {Aim | null} aim
 * @property {Photographs | null} photographs
 * @property {Calibration | null} calibration
 * @property {Scene | null} scene
 * @property {Session | null} session
 * @property {Live | null} live
 * @property {Reference} reference
 *
 * @typedef {object} State
 * @property {number} version
 * @property {number} now_ms
 * @property {{version: string, folder: string, computer: string, pages: number, problems: Problem[], streams: string[], studies_version: number, latest_study: string | null}} desk
 * @property {BoxState[]} boxes
 * @property {{address: string, name: string, problem: Problem}[]} strangers
 *
 * @typedef {{p: [number, number, number], c: [number, number, number]}} PointRow
 * @typedef {{number: number, at_ms: number, upper: PointRow | null, lower: PointRow | null, gap?: number, is_late?: boolean}} FrameRow
 *
 * @typedef {object} ProtocolView
 * @property {string} text
 * @property {any} fields
 * @property {number} trials
 * @property {number} lasts_s
 *
 * @typedef {{code: string, age_years: number | null, sex: string | null, height_cm: number | null, mass_kg: number | null}} Participant
 *
 * @typedef {object} SessionRow
 * @property {string} name
 * @property {string} participant
 * @property {string} started
 * @property {string} state
 * @property {boolean} can_resume
 * @property {string | null} open_with
 * @property {number} done
 * @property {number} planned
 * @property {Trial[]} trials
 * @property {Problem | null} problem
 *
 * @typedef {object} Study
 * @property {string} folder
 * @property {string} title
 * @property {string} path
 * @property {ProtocolView} protocol
 * @property {Participant[]} participants
 * @property {SessionRow[]} sessions
 * @property {number} accepted
 */

export {};
