// How hard a new password is to guess, by what makes it long: repetitions and rows such as 1234 count for nothing.
// The service refuses what is too short, or among the commonest; this only helps to choose.

export const LEAST = 12; // characters, as the service asks for
const FAIR = 12;
const STRONG = 18; // four words

export type Strength = 'short' | 'weak' | 'fair' | 'strong';
export const STRENGTHS: readonly Strength[] = ['short', 'weak', 'fair', 'strong'];

/** Characters that are neither the one before again, nor next to it in a row, nor part of a piece that came before. */
export function surprises(password: string): number {
  const text = [...password.toLowerCase()];
  const codes = text.map((each) => each.codePointAt(0) ?? 0);
  let n = 0;
  for (let i = 0; i < text.length; i++) {
    const isRow = i > 0 && Math.abs((codes[i] ?? 0) - (codes[i - 1] ?? 0)) <= 1;
    const isAgain =
      i >= 2 &&
      text
        .slice(0, i)
        .join('')
        .includes(text.slice(i - 2, i + 1).join(''));
    if (!isRow && !isAgain) n++;
  }
  return n;
}

/** Return what a new password is worth. */
export function strength(password: string): Strength {
  if ([...password].length < LEAST) return 'short';
  const n = surprises(password);
  return n >= STRONG ? 'strong' : n >= FAIR ? 'fair' : 'weak';
}
