// A message of the service, a code with arguments, as text in one language: the twin of app/words/render.py. Both read
// tests/vectors/words.json.

export interface Message {
  code: string;
  args: Record<string, unknown>;
}
export type Template = string | { one: string; other: string };
export type Table = Readonly<Record<string, Template>>;

type Structured =
  | Message
  | { index: number }
  | { pack: number }
  | { value: number | null; unit: string; digits: number | null };

const UNITS: Record<string, string> = { degC: '°C', mohm: 'mΩ', ohm: 'Ω', uohm: 'µΩ' };

/** `message` by the templates of `table`, cells named by a battery's `segments`; a code the table lacks is shown. */
export function render(message: Message, table: Table, segments: readonly number[]): string {
  const found = table[message.code] ?? message.code;
  const template =
    typeof found === 'string' ? found : found[(message.args['n'] ?? 1) === 1 ? 'one' : 'other'];
  return template.replace(/\{(\w+)\}/g, (whole, name: string) =>
    name in message.args ? text(message.args[name], table, segments) : whole,
  );
}

function text(argument: unknown, table: Table, segments: readonly number[]): string {
  if (typeof argument === 'string') return argument;
  if (Array.isArray(argument)) return argument.map((each) => text(each, table, segments)).join(', ');
  if (typeof argument !== 'object' || argument === null) return decimal(argument as number | null, null);
  const it = argument as Structured;
  if ('code' in it) return render(it, table, segments);
  if ('index' in it) return cellText(it.index, table, segments);
  if ('pack' in it) return String(it.pack + 1);
  return `${decimal(it.value, it.digits)} ${UNITS[it.unit] ?? it.unit}`.trimEnd();
}

function cellText(index: number, table: Table, segments: readonly number[]): string {
  let start = 0;
  for (const [pack, size] of segments.entries()) {
    if (index < start + size)
      return render({ code: 'cell', args: { pack: pack + 1, cell: index - start + 1 } }, table, []);
    start += size;
  }
  return render({ code: 'cell-number', args: { cell: index + 1 } }, table, []);
}

/** A number with so many digits after the point, or as many as it needs up to six; a missing one is a dash. */
function decimal(value: number | null, digits: number | null): string {
  if (value === null || !Number.isFinite(value)) return '–';
  if (digits !== null) return value.toFixed(digits);
  if (Number.isInteger(value)) return String(value + 0);
  const six = Number(value.toPrecision(6));
  return Math.abs(six) < 1e-6 ? six.toFixed(12).replace(/0+$/, '') : String(six);
}
