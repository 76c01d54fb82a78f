import { describe, expect, it } from 'vitest';
import { fitting, placesIn, type Entry } from '../src/store/find_entry';
import { Shape } from '../src/store/shape.svelte';

const entry = (name: string, part: Partial<Entry> = {}): Entry => ({
  id: name,
  name,
  detail: '',
  act: () => undefined,
  ...part,
});
const ENTRIES = [
  entry('Overview', { detail: 'Page' }),
  entry('Økter', { detail: 'Side', also: 'Sessions' }),
  entry('Acknowledge all alarms'),
  entry('Theme: dark'),
  entry('v_cell_max', { detail: 'largest voltage of a cell', hidden: true }),
  entry('t_cell_max', { detail: 'largest temperature of a cell', hidden: true }),
  entry('run 7', { detail: 'Session · 2026-05-03 10:31', hidden: true }),
];
const names = (typed: string): string[] => fitting(ENTRIES, typed).map((e) => e.name);

describe('entries', () => {
  it('fit by the beginnings and parts of words, in any order', () => {
    expect(names('all ack')).toEqual(['Acknowledge all alarms']);
    expect(names('DARK theme')).toEqual(['Theme: dark']);
    expect(names('max cell v')).toEqual(['v_cell_max']);
    expect(names('v_cell')).toEqual(['v_cell_max']);
  });

  it('fit only where every word does', () => {
    expect(names('theme cell')).toEqual([]);
    expect(names('overviews')).toEqual([]);
  });

  it('are found without the marks of their letters, in English too, and by what stands beside them', () => {
    expect(names('okter')).toEqual(['Økter']);
    expect(names('ØKT')).toEqual(['Økter']);
    expect(names('sessions')).toEqual(['Økter']);
    expect(names('temperature')).toEqual(['t_cell_max']);
    expect(names('2026 run')).toEqual(['run 7']);
  });

  it('begin with those whose name begins so', () => {
    const list = [entry('remark'), entry('a mark'), entry('mark a lap'), entry('other', { detail: 'mark' })];
    expect(fitting(list, 'mark').map((e) => e.name)).toEqual(['mark a lap', 'a mark', 'remark', 'other']);
  });

  it('that are many are left out before something is typed', () => {
    expect(names('  ')).toEqual(['Overview', 'Økter', 'Acknowledge all alarms', 'Theme: dark']);
  });
});

describe('places', () => {
  const shape = new Shape({ segments: [12, 12, 10] });
  const NAMES = { pack: ['pack', 'pakke'], cell: ['cell', 'celle'] };
  const at = (typed: string): unknown =>
    placesIn(typed, shape, NAMES).map(({ pack, cell }) => (cell === null ? `pack ${pack}` : [pack, cell]));

  it('of a cell are said in many ways', () => {
    for (const typed of [
      '3 7',
      'p3 c7',
      'p3c7',
      'pack 3, cell 7',
      'Pakke 3 celle 7',
      'c7 p3',
      '3/7',
      '3 c7',
      'p3 7',
    ])
      expect(at(typed)).toEqual([[3, 7]]);
  });

  it('of one number are a pack, a cell of the string, or both', () => {
    expect(at('cell 31')).toEqual([[3, 7]]);
    expect(at('31')).toEqual([[3, 7]]);
    expect(at('p2')).toEqual(['pack 2']);
    expect(at('2')).toEqual(['pack 2', [1, 2]]);
  });

  it('are none where the battery has none, or words stand beside them', () => {
    for (const typed of [
      '',
      '0',
      'p4',
      '4 1',
      '3 11',
      'cell 35',
      '1 2 3',
      'c1 c2',
      'p1 p2',
      'run 7',
      '3 7 run',
      '-',
    ])
      expect(at(typed)).toEqual([]);
  });

  it('round trip for every cell of any battery', () => {
    shape.outline.segments.forEach((size, pack) => {
      for (let cell = 1; cell <= size; cell++) expect(at(`${pack + 1} ${cell}`)).toEqual([[pack + 1, cell]]);
    });
  });
});
