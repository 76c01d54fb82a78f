// A report, a black box or a reaction test as a file of its own: the service or the command line puts its data into `#data`.

import { mount } from 'svelte';
import './theme/tokens.css';
import './theme/base.css';
import './theme/controls.css';
import './theme/print.css';
import Document from './views/Document.svelte';
import type { BlackBox, Evidence, Report, SeasonCell, SeasonOverview, SeasonSession } from './link/types';
import { shapes } from './store/shape.svelte';
import { paper } from './store/paper.svelte';
import { chosen } from './words/words.svelte';

export interface SeasonReport {
  battery: string;
  segments: number[];
  made_s: number;
  voltwall: string;
  sessions: SeasonSession[];
  cars: { overview: SeasonOverview; curves: SeasonCell[] }[];
}

export type Subject =
  | { kind: 'season'; data: SeasonReport }
  | { kind: 'report'; data: Report }
  | { kind: 'black-box'; data: BlackBox }
  | { kind: 'evidence'; data: Evidence };

const { language, ...subject } = JSON.parse(document.getElementById('data')!.textContent) as Subject & {
  language: string;
};
const dark = matchMedia('(prefers-color-scheme: dark)').matches;
document.documentElement.dataset['theme'] = dark ? 'dark' : 'light';
const TEAM = Array<number>(8).fill(12); // documents without it are of the built-in car
shapes.show({ segments: 'segments' in subject.data ? (subject.data.segments as number[]) : TEAM });
paper.start();
await chosen.set(language, false);
mount(Document, { target: document.getElementById('app')!, props: { subject } });
