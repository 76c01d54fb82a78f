// The texts of the pages. English stands in the code and is the key; the types come from the tables of one language,
// so a text that has no translation does not compile. That all languages have the same keys is a test of the service.

import type can from '../../../app/words/nb/page/can.json';
import type debrief from '../../../app/words/nb/page/debrief.json';
import type evidence from '../../../app/words/nb/page/evidence.json';
import type fleet from '../../../app/words/nb/page/fleet.json';
import type help from '../../../app/words/nb/page/help.json';
import type overview from '../../../app/words/nb/page/overview.json';
import type packs from '../../../app/words/nb/page/packs.json';
import type parameters from '../../../app/words/nb/page/parameters.json';
import type recording from '../../../app/words/nb/page/recording.json';
import type season from '../../../app/words/nb/page/season.json';
import type sessions from '../../../app/words/nb/page/sessions.json';
import type setup from '../../../app/words/nb/page/setup.json';
import type shell from '../../../app/words/nb/page/shell.json';
import type simulator from '../../../app/words/nb/page/simulator.json';
import type sql from '../../../app/words/nb/page/sql.json';
import type system from '../../../app/words/nb/page/system.json';

export type Text =
  | keyof typeof can
  | keyof typeof debrief
  | keyof typeof evidence
  | keyof typeof fleet
  | keyof typeof help
  | keyof typeof overview
  | keyof typeof packs
  | keyof typeof parameters
  | keyof typeof recording
  | keyof typeof season
  | keyof typeof sessions
  | keyof typeof setup
  | keyof typeof shell
  | keyof typeof simulator
  | keyof typeof sql
  | keyof typeof system;
