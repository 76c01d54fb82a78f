// Draft, in force, stored: three configurations that the page never confuses. The draft survives reconnects and reloads.

import type { Difference, ConfigIssue, Config, Schema, StoredConfig, WriteResult } from '../link/types';
import { messageText, t } from '../words/words.svelte';
import { call, get, post, Problem } from '../link/rest';
import { live } from './live.svelte';
import { changes, draftOf, rawBody, rebase, type Draft } from './draft';

const KEY = 'voltwall.draft';
const notRead = (): Problem =>
  new Problem(503, t('parameters.not_received_yet'), {
    detail: t('parameters.master_not_sent_configuration_yet'),
  });

class ConfigStore {
  schema = $state.raw<Schema | null>(null);
  config = $state.raw<Config | null>(null);
  stored = $state.raw<StoredConfig | null>(null);
  nothingStored = $state(false);
  draft = $state.raw<Draft>(JSON.parse(sessionStorage.getItem(KEY) ?? '{}') as Draft);
  problem = $state.raw<Problem | null>(null);
  outcome = $state.raw<WriteOutcome | null>(null);
  checked = $state.raw<WriteResult | null>(null);
  unconfirmed = $state.raw<Unconfirmed | null>(null);
  serverErrors = $state.raw<Record<string, string>>({});
  busy = $state<string | null>(null);

  changes = $derived(this.schema ? changes(this.draft, this.schema.fields, this.config?.raw ?? null) : []);
  unstored = $derived(
    this.nothingStored ||
      (this.config !== null && this.stored !== null && this.config.hash !== this.stored.hash),
  );
  invalid = $derived(this.changes.filter((c) => c.verdict.error !== null));

  setDraft(draft: Draft): void {
    this.draft = draft;
    this.checked = null;
    this.serverErrors = {};
    sessionStorage.setItem(KEY, JSON.stringify(draft));
  }

  /** Read what is in force and what is stored; edits stay. */
  async load(): Promise<void> {
    await this.readInForce();
    if (this.config !== null) await this.readStored();
  }

  private async readInForce(): Promise<void> {
    try {
      this.schema ??= await get<Schema>('config/schema');
      if ((live.snapshot?.config_hash ?? null) === null) throw notRead();
      this.config = await get<Config>('config');
      this.problem = null;
      this.draft = rebase(this.draft, this.schema.fields, this.config.raw);
    } catch (error) {
      this.problem = asProblem(error);
    }
  }

  private async readStored(): Promise<void> {
    try {
      this.stored = await get<StoredConfig | null>('config/stored');
      this.nothingStored = this.stored === null;
    } catch (error) {
      asProblem(error);
      this.nothingStored = false;
      this.stored = null;
    }
  }

  /** After a write or a store without an answer: report its outcome once the master is received again. */
  async settle(configAgeS: number | null): Promise<void> {
    const unconfirmed = this.unconfirmed;
    if (!unconfirmed || this.busy || configAgeS === null) return;
    if (configAgeS * 1000 > Date.now() - unconfirmed.sinceMs) return;
    this.unconfirmed = null;
    await this.load();
    if (this.problem) this.unconfirmed = unconfirmed;
    else if (unconfirmed.what === 'storing') this.outcome = storeResult(this.unstored);
    else {
      const isWanted = unconfirmed.what === 'loading' ? !this.unstored : this.changes.length === 0;
      this.outcome = writeUnconfirmed(
        this.config?.hash === unconfirmed.old ? 'old' : isWanted ? 'new' : 'other',
      );
    }
  }

  /** Let the service check the draft without writing it. */
  async check(): Promise<boolean> {
    this.checked = await this.attempt('checking', (hash) =>
      call<WriteResult>('config?dry_run=true', this.request(hash)),
    );
    if (this.checked) this.outcome = null;
    return this.checked !== null;
  }

  async write(reason = ''): Promise<void> {
    const result = await this.attempt('writing', (hash) =>
      call<WriteResult>('config', this.request(hash, reason)),
    );
    if (result) await this.written(result, t('parameters.written_and_verified'));
  }

  /** Say that a write came to its end, and show what is in force now. */
  async written(result: WriteResult, title: string): Promise<void> {
    const n = result.difference.length;
    await this.readInForce();
    this.checked = null;
    this.outcome = {
      kind: result.verified ? 'good' : 'bad',
      title: result.verified ? title : t('common.written_but_read_back_does'),
      text: [
        n === 1 ? t('parameters.1_value_now_active') : t('parameters.values_now_active', { n }),
        afterRestart(this.nothingStored || this.stored !== null ? !this.unstored : null),
      ].join(' '),
      difference: result.difference,
    };
  }

  /** Take a whole configuration from a named source as the draft. */
  async useSource(source: string): Promise<void> {
    const other = await this.attempt('reading', () =>
      get<Pick<Config, 'raw'>>(`config/source?${new URLSearchParams({ name: source })}`),
    );
    if (!other || !this.schema || !this.config) return;
    this.setDraft(draftOf(this.schema.fields, this.config.raw, other.raw));
    const n = this.changes.length;
    this.outcome = {
      kind: 'good',
      title: n === 0 ? t('parameters.same_active_configuration') : t('parameters.added_changes'),
      text:
        n === 0
          ? ''
          : n === 1
            ? t('parameters.1_value_differs_active_configuration')
            : t('parameters.values_differ_active_configuration', { n }),
    };
  }

  async store(): Promise<void> {
    await this.act('storing', async () => {
      const result = await post<{ verified: boolean; counter: number }>('config/store');
      this.outcome = {
        kind: result.verified ? 'good' : 'bad',
        title: result.verified
          ? t('parameters.stored_eeprom_verified')
          : t('parameters.eeprom_does_not_match_stored'),
        text: t('parameters.store_number_master_uses_next', { n: result.counter }),
      };
      await this.load();
    });
  }

  async loadStored(): Promise<void> {
    await this.act('loading', async () => {
      await post('config/load');
      this.outcome = {
        kind: 'good',
        title: t('parameters.loaded_from_eeprom'),
        text: t('parameters.stored_configuration_active_again'),
      };
      await this.load();
    });
  }

  private request(hash: string, reason = ''): { method: 'PUT'; body: unknown; ifMatch: string } {
    return { method: 'PUT', body: { raw: rawBody(this.changes, this.config!.raw), reason }, ifMatch: hash };
  }

  /** Do one thing with the hash in force; null after the failure was explained. */
  async attempt<T>(what: string, action: (hash: string) => Promise<T>): Promise<T | null> {
    let result: T | null = null;
    await this.act(what, async (hash) => {
      result = await action(hash);
    });
    return result;
  }

  private async act(what: string, action: (hash: string) => Promise<void>): Promise<void> {
    if (!this.config || this.busy) return;
    this.busy = what;
    this.serverErrors = {};
    try {
      await action(this.config.hash);
    } catch (error) {
      await this.explain(asProblem(error), what);
    } finally {
      this.busy = null;
    }
  }

  private async explain(problem: Problem, what: string): Promise<void> {
    const lost = problem.status === 0 && (what === 'writing' || what === 'loading');
    const inForce = lost ? 'unknown' : (problem.body['in_force'] as InForce | undefined);
    const unanswered = problem.status === 0 || problem.status >= 503;
    this.serverErrors = Object.fromEntries(problem.errors.map((e) => [e.field, messageText(e.message)]));
    if (problem.status === 412) {
      const difference = (problem.body['difference'] ?? []) as Difference[];
      const meanwhile = (problem.body['meanwhile'] ?? []) as Difference[];
      await this.load();
      this.outcome = {
        kind: 'conflict',
        title: t('parameters.another_user_changed_configuration'),
        text: t('parameters.nothing_written_active_configuration'),
        difference,
        meanwhile,
      };
    } else if (unanswered && (inForce !== undefined || what === 'storing')) {
      const old = this.config?.hash ?? '';
      await this.load();
      this.outcome =
        what === 'storing' ? storeUnconfirmed(problem.detail) : writeUnconfirmed(inForce ?? 'unknown');
      const isSettled = what !== 'storing' && inForce !== 'unknown';
      if (!isSettled && (what === 'writing' || what === 'storing' || what === 'loading'))
        this.unconfirmed = { what, old, sinceMs: Date.now() };
    } else {
      const findings = problem.errors.filter((e): e is ConfigIssue & typeof e => 'level' in e);
      const nothing =
        findings.length > 0 || (unanswered && what === 'writing') ? t('parameters.nothing_was_written') : '';
      const text = [findings.length > 0 ? '' : `${problem.detail}${nothing && '.'}`, nothing]
        .filter(Boolean)
        .join(' ');
      this.outcome = { kind: 'bad', title: problem.title, text, findings };
    }
  }
}

/** What a restart would bring, after a write. */
function afterRestart(isStored: boolean | null): string {
  if (isStored === null) return t('parameters.eeprom_contents_unknown_read_them');
  return isStored
    ? t('parameters.eeprom_contains_same_configuration')
    : t('parameters.not_eeprom_yet_store_keep');
}

function asProblem(error: unknown): Problem {
  if (error instanceof Problem) return error;
  throw error;
}

export const config = new ConfigStore();

// How a write or a store ended, in words: also where its answer was lost and the master has to be read again.
export type WriteOutcome = {
  kind: 'good' | 'bad' | 'conflict';
  title: string;
  text: string;
  difference?: Difference[];
  meanwhile?: Difference[];
  findings?: ConfigIssue[];
};

/** What the service found in force after a write that it could not verify. */
export type InForce = 'old' | 'new' | 'other' | 'unknown';

/** A write, a load or a store without an answer, until the master is received again. */
export interface Unconfirmed {
  what: 'writing' | 'loading' | 'storing';
  old: string; // hash of what was in force
  sinceMs: number;
}

/** What is in force after a write whose answer was lost. */
export function writeUnconfirmed(inForce: InForce): WriteOutcome {
  switch (inForce) {
    case 'old':
      return {
        kind: 'bad',
        title: t('parameters.not_written_old_configuration_active'),
        text: t('parameters.master_read_again_changes_kept'),
      };
    case 'new':
      return {
        kind: 'good',
        title: t('parameters.written_new_configuration_active'),
        text: t('parameters.only_response_lost_master_read'),
      };
    case 'other':
      return {
        kind: 'bad',
        title: t('parameters.different_configuration_active'),
        text: t('parameters.neither_old_nor_new_one'),
      };
    case 'unknown':
      return {
        kind: 'bad',
        title: t('parameters.active_configuration_unknown'),
        text: t('parameters.no_response_master_uses_either'),
      };
  }
}

export const storeUnconfirmed = (detail: string): WriteOutcome => ({
  kind: 'bad',
  title: t('parameters.stored_configuration_unknown'),
  text: `${detail}. ${t('parameters.eeprom_contains_either_old_new')}`,
});

/** What the EEPROM holds after a store whose answer was lost. */
export const storeResult = (differs: boolean): WriteOutcome =>
  differs
    ? {
        kind: 'bad',
        title: t('parameters.not_stored_eeprom_still_contains'),
        text: t('parameters.store_did_not_finish_safely'),
      }
    : {
        kind: 'good',
        title: t('parameters.stored_eeprom_contains_active'),
        text: t('parameters.only_response_lost_eeprom_read'),
      };
