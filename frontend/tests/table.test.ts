import { describe, expect, it } from 'vitest';
import { csv, hasWords, orderOf, sortValue, tableCsv } from '../src/store/table';

const sorted = (texts: string[], descending = false): string[] =>
  orderOf(texts, descending).map((i) => texts[i]!);

describe('the order of a column', () => {
  it('is that of its numbers, whatever unit prefix they are written with', () => {
    expect(sorted(['1.4 MB', '812 B', '96.0 kB'])).toEqual(['812 B', '96.0 kB', '1.4 MB']);
    expect(sorted(['3 min', '0.2 s', '2 h', '14 s'])).toEqual(['0.2 s', '14 s', '3 min', '2 h']);
    expect(sorted(['1\u2009024', '−3', '+2.5', '12'])).toEqual(['−3', '+2.5', '12', '1\u2009024']);
    expect(sorted(['1:02:03', '59:59', '00:07'])).toEqual(['00:07', '59:59', '1:02:03']);
  });

  it('counts the numbers within words', () => {
    expect(sorted(['pack 10, cell 2', 'pack 2, cell 11', 'pack 2, cell 9'])).toEqual([
      'pack 2, cell 9',
      'pack 2, cell 11',
      'pack 10, cell 2',
    ]);
    expect(sorted(['2026-11-23 08:14', '2026-02-01 23:00'])).toEqual([
      '2026-02-01 23:00',
      '2026-11-23 08:14',
    ]);
  });

  it('has what is missing last either way, and equal rows as they stood', () => {
    expect(orderOf(['–', '2', '', '1'], false)).toEqual([3, 1, 0, 2]);
    expect(orderOf(['–', '2', '', '1'], true)).toEqual([1, 3, 0, 2]);
    expect(orderOf(['b', 'a', 'b', 'a'], true)).toEqual([0, 2, 1, 3]);
  });

  it('takes a text that is no number for none', () => {
    for (const text of ['3.652 … 3.700', 'v[36]', '0x310', '2026-11-23 08:14', 'run 3']) {
      expect(sortValue(text)).toBeNull();
    }
    expect(sortValue('−0.021 V')).toBe(-0.021);
  });
});

describe('a table as CSV', () => {
  it('has the unit of a column in its name and numbers that every program reads', () => {
    const rows = [
      ['1', '78.2 s', '−0.5 %', '–'],
      ['2', '1\u2009080.0 s', '+3 %', '4 K'],
    ];
    expect(tableCsv(['Lap', 'Lap time', 'Change', 'Warmer'], rows)).toBe(
      'Lap,Lap time [s],Change [%],Warmer [K]\r\n1,78.2,-0.5,\r\n2,1080.0,3,4\r\n',
    );
  });

  it('leaves a column alone whose units differ', () => {
    expect(tableCsv(['Size'], [['812 B'], ['1.4 MB']])).toBe('Size\r\n812 B\r\n1.4 MB\r\n');
  });

  it('quotes what would end a field', () => {
    expect(csv([['a,b', 'say "x"', 'two\nlines']])).toBe('"a,b","say ""x""","two\nlines"\r\n');
  });
});

it.each(['=1+1', "+cmd|'/C calc'!A0", '-2+3', '@SUM(A1)', '\t=1', '\r=1', '\n=1', '-', '-1+A!b'])(
  'a spreadsheet does not run %j',
  (text) => {
    expect(csv([[text]]).replace(/^"/, '')).toMatch(/^'/);
  },
);

it.each(['-3.2', '+5', '-1e-9', '-3.2 A', '+3 %', '−0.5 %'])('%s stays a number', (text) => {
  expect(csv([[text]])).toBe(`${text}\r\n`);
});

it('a row fits when it has all words in any order', () => {
  expect(hasWords('trip Cell voltage low Pack 3', 'low trip')).toBe(true);
  expect(hasWords('trip Cell voltage low', 'low watch')).toBe(false);
});
