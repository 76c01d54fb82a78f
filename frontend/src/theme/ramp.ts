// The cells' colours: straight lines in OKLab, so equal steps of a value are equal steps to the eye.
// Blue to yellow through grey keeps its order for every common colour vision; text on it is black or white.

type Lab = readonly [number, number, number];

const STEPS = 48;
const LOW: Lab = [0.29, -0.012, -0.095];
const HIGH: Lab = [0.9, -0.012, 0.15];
const COOL: Lab = [0.5, -0.04, -0.13];
const NEUTRAL: Lab = [0.93, 0, 0.004];
const WARM: Lab = [0.52, 0.1, 0.1];

export interface Swatch {
  fill: string;
  ink: string;
  luminance: number; // WCAG relative luminance, 0..1
}

function linearRgb([l, a, b]: Lab): [number, number, number] {
  const l3 = (l + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m3 = (l - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s3 = (l - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const clip = (x: number): number => Math.min(1, Math.max(0, x));
  return [
    clip(4.0767416621 * l3 - 3.3077115913 * m3 + 0.2309699292 * s3),
    clip(-1.2684380046 * l3 + 2.6097574011 * m3 - 0.3413193965 * s3),
    clip(-0.0041960863 * l3 - 0.7034186147 * m3 + 1.707614701 * s3),
  ];
}

function swatch(lab: Lab): Swatch {
  const rgb = linearRgb(lab);
  const luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
  const byte = (x: number): number =>
    Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
  return {
    fill: `rgb(${rgb.map(byte).join(' ')})`,
    ink: luminance > 0.179 ? '#000' : '#fff',
    luminance,
  };
}

const mix = (a: Lab, b: Lab, x: number): Lab => [
  a[0] + (b[0] - a[0]) * x,
  a[1] + (b[1] - a[1]) * x,
  a[2] + (b[2] - a[2]) * x,
];

const table = (at: (x: number) => Lab): Swatch[] =>
  Array.from({ length: STEPS }, (_, i) => swatch(at(i / (STEPS - 1))));

export const SEQUENTIAL = table((x) => mix(LOW, HIGH, x));
export const DIVERGING = table((x) => (x < 0.5 ? mix(COOL, NEUTRAL, 2 * x) : mix(NEUTRAL, WARM, 2 * x - 1)));

/** The swatch at fraction `x` of a ramp. */
export function at(ramp: readonly Swatch[], x: number): Swatch {
  const i = Math.round(Math.min(1, Math.max(0, x)) * (ramp.length - 1));
  return ramp[i]!;
}

/** CSS gradient of a ramp, left to right, for its legend. */
export const gradient = (ramp: readonly Swatch[]): string =>
  `linear-gradient(90deg, ${ramp
    .filter((_, i) => i % 4 === 0 || i === ramp.length - 1)
    .map((s) => s.fill)
    .join(', ')})`;
