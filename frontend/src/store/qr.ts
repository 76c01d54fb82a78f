// A QR code (ISO/IEC 18004, model 2) of a short text: byte mode, error correction M, versions 1 to 6.

interface Version {
  ec: number; // correction bytes a block
  blocks: number;
  data: number; // data bytes a block
  align: number; // centre of the alignment pattern, 0 for none
}

const VERSIONS: readonly Version[] = [
  { ec: 10, blocks: 1, data: 16, align: 0 },
  { ec: 16, blocks: 1, data: 28, align: 18 },
  { ec: 26, blocks: 1, data: 44, align: 22 },
  { ec: 18, blocks: 2, data: 32, align: 26 },
  { ec: 24, blocks: 2, data: 43, align: 30 },
  { ec: 16, blocks: 4, data: 27, align: 34 },
];
const LEVEL_M = 0b00;
const FIELD = 0x11d; // x^8 + x^4 + x^3 + x^2 + 1
const FORMAT = 0x537; // BCH(15, 5)
const FORMAT_MASK = 0x5412;

const MASKS: readonly ((x: number, y: number) => boolean)[] = [
  (x, y) => (x + y) % 2 === 0,
  (_, y) => y % 2 === 0,
  (x) => x % 3 === 0,
  (x, y) => (x + y) % 3 === 0,
  (x, y) => (Math.floor(x / 3) + Math.floor(y / 2)) % 2 === 0,
  (x, y) => ((x * y) % 2) + ((x * y) % 3) === 0,
  (x, y) => (((x * y) % 2) + ((x * y) % 3)) % 2 === 0,
  (x, y) => (((x + y) % 2) + ((x * y) % 3)) % 2 === 0,
];

/** Product in GF(256) as QR codes use it. */
export function multiply(a: number, b: number): number {
  let product = 0;
  for (let bit = 7; bit >= 0; bit--) {
    product = (product << 1) ^ ((product >> 7) * FIELD);
    product ^= ((b >> bit) & 1) * a;
  }
  return product;
}

function correction(data: readonly number[], length: number): number[] {
  const divisor = new Array<number>(length).fill(0);
  divisor[length - 1] = 1;
  let root = 1;
  for (let i = 0; i < length; i++) {
    for (let j = 0; j < length; j++) divisor[j] = multiply(divisor[j]!, root) ^ (divisor[j + 1] ?? 0);
    root = multiply(root, 2);
  }
  const rest = new Array<number>(length).fill(0);
  for (const byte of data) {
    const factor = byte ^ rest.shift()!;
    rest.push(0);
    divisor.forEach((d, i) => (rest[i]! ^= multiply(d, factor)));
  }
  return rest;
}

function codewords(bytes: Uint8Array, v: Version): number[] {
  const room = v.blocks * v.data;
  const bits: number[] = [];
  const put = (value: number, n: number): void => {
    for (let i = n - 1; i >= 0; i--) bits.push((value >> i) & 1);
  };
  put(0b0100, 4);
  put(bytes.length, 8);
  for (const byte of bytes) put(byte, 8);
  put(0, Math.min(4, room * 8 - bits.length));
  put(0, (8 - (bits.length % 8)) % 8);
  const data: number[] = [];
  for (let i = 0; i < bits.length; i += 8) data.push(bits.slice(i, i + 8).reduce((a, b) => a * 2 + b, 0));
  for (let pad = 0xec; data.length < room; pad ^= 0xec ^ 0x11) data.push(pad);
  const blocks = Array.from({ length: v.blocks }, (_, i) => data.slice(i * v.data, (i + 1) * v.data));
  const checks = blocks.map((block) => correction(block, v.ec));
  const out: number[] = [];
  for (let i = 0; i < v.data; i++) for (const block of blocks) out.push(block[i]!);
  for (let i = 0; i < v.ec; i++) for (const check of checks) out.push(check[i]!);
  return out;
}

/** The 15 bits that name level and mask. */
export function formatBits(mask: number): number {
  const data = (LEVEL_M << 3) | mask;
  let rest = data;
  for (let i = 0; i < 10; i++) rest = (rest << 1) ^ ((rest >> 9) * FORMAT);
  return ((data << 10) | rest) ^ FORMAT_MASK;
}

type Grid = boolean[][];

/** Modules that are not data: finders, separators, timing, alignment, format, the dark module. */
function frame(size: number, v: Version): { dark: Grid; taken: Grid } {
  const grid = (): Grid => Array.from({ length: size }, () => new Array<boolean>(size).fill(false));
  const dark = grid();
  const taken = grid();
  const set = (x: number, y: number, on: boolean): void => {
    if (x < 0 || y < 0 || x >= size || y >= size) return;
    dark[y]![x] = on;
    taken[y]![x] = true;
  };
  for (let i = 0; i < size; i++) {
    set(6, i, i % 2 === 0);
    set(i, 6, i % 2 === 0);
  }
  const square = (cx: number, cy: number, reach: number, light: readonly number[]): void => {
    for (let dy = -reach; dy <= reach; dy++) {
      for (let dx = -reach; dx <= reach; dx++) {
        set(cx + dx, cy + dy, !light.includes(Math.max(Math.abs(dx), Math.abs(dy))));
      }
    }
  };
  for (const [x, y] of [
    [3, 3],
    [size - 4, 3],
    [3, size - 4],
  ] as const) {
    square(x, y, 4, [2, 4]);
  }
  if (v.align) square(v.align, v.align, 2, [1]);
  for (let i = 0; i < 9; i++) {
    if (i !== 6) {
      set(8, i, false);
      set(i, 8, false);
    }
    if (i < 8) {
      set(size - 1 - i, 8, false);
      set(8, size - 1 - i, false);
    }
  }
  return { dark, taken };
}

function writeFormat(dark: Grid, mask: number): void {
  const size = dark.length;
  const bits = formatBits(mask);
  const bit = (i: number): boolean => ((bits >> i) & 1) === 1;
  for (let i = 0; i < 6; i++) {
    dark[i]![8] = bit(i);
    dark[8]![5 - i] = bit(9 + i);
  }
  dark[7]![8] = bit(6);
  dark[8]![8] = bit(7);
  dark[8]![7] = bit(8);
  for (let i = 0; i < 8; i++) dark[8]![size - 1 - i] = bit(i);
  for (let i = 8; i < 15; i++) dark[size - 15 + i]![8] = bit(i);
  dark[size - 8]![8] = true;
}

/** The cells of the grid in the order in which data fills them: pairs of columns from the right, up and down. */
export function* dataOrder(size: number): Generator<[x: number, y: number]> {
  for (let right = size - 1; right >= 1; right -= 2) {
    if (right === 6) right = 5;
    const up = ((right + 1) & 2) === 0;
    for (let i = 0; i < size; i++) {
      for (const x of [right, right - 1]) yield [x, up ? size - 1 - i : i];
    }
  }
}

/** How hard a grid is to read: long runs, blocks, an unbalanced share of dark. */
function penalty(dark: Grid): number {
  const size = dark.length;
  let points = 0;
  let count = 0;
  for (const turned of [false, true]) {
    const cell = (i: number, j: number): boolean => (turned ? dark[j]![i]! : dark[i]![j]!);
    for (let i = 0; i < size; i++) {
      let run = 0;
      for (let j = 0; j < size; j++) {
        run = j > 0 && cell(i, j) === cell(i, j - 1) ? run + 1 : 1;
        if (run === 5) points += 3;
        else if (run > 5) points++;
      }
    }
  }
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const here = dark[y]![x]!;
      if (here) count++;
      if (x && y && here === dark[y]![x - 1] && here === dark[y - 1]![x] && here === dark[y - 1]![x - 1])
        points += 3;
    }
  }
  return points + 10 * Math.floor(Math.abs(count * 20 - size * size * 10) / (size * size));
}

/** Rows of modules, true where dark, without the quiet zone; null where the text is longer than 106 bytes. */
export function qrCode(text: string): boolean[][] | null {
  const bytes = new TextEncoder().encode(text);
  const number = VERSIONS.findIndex((v) => bytes.length + 2 <= v.blocks * v.data);
  const v = VERSIONS[number];
  if (!v) return null;
  const size = 21 + 4 * number;
  const { dark, taken } = frame(size, v);
  const words = codewords(bytes, v);
  let i = 0;
  for (const [x, y] of dataOrder(size)) {
    if (taken[y]![x]) continue;
    dark[y]![x] = (((words[i >> 3] ?? 0) >> (7 - (i & 7))) & 1) === 1;
    i++;
  }
  let best: Grid | null = null;
  let least = Infinity;
  MASKS.forEach((mask, name) => {
    const tried = dark.map((row, y) => row.map((on, x) => (taken[y]![x] ? on : on !== mask(x, y))));
    writeFormat(tried, name);
    const points = penalty(tried);
    if (points < least) {
      least = points;
      best = tried;
    }
  });
  return best;
}
