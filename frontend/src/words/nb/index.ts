// Norwegian: the sentences of the service by pattern, until each of them is a code with arguments.
import service from './service.json';

/** Sentences that the service composes: whole texts, and patterns of which the first that fits is taken. */
export interface Said {
  texts: Readonly<Record<string, string>>;
  patterns: readonly (readonly [RegExp, string])[]; // $1 is what the pattern found, itself translated
}

export const SAID: Said = {
  texts: service.texts,
  patterns: service.patterns.map(([pattern, words]) => [new RegExp(`^${pattern}$`), words!] as const),
};
