// The REST client: every failure is a Problem that says what happened and which field it concerns.

import type { RenderedMessage } from '../generated/api';
import { t, messageText } from '../words/words.svelte';

const BASE = '/api/v1';

export interface FieldError {
  field: string;
  value?: unknown;
  limit?: RenderedMessage;
  message: RenderedMessage;
}

/** A failed request: an RFC 9457 document from the service, or status 0 when it could not be reached. */
export class Problem extends Error {
  readonly status: number;
  readonly detail: string;
  readonly errors: FieldError[];
  readonly body: Record<string, unknown>;

  constructor(status: number, title: string, body: Record<string, unknown> = {}) {
    super(title);
    this.status = status;
    this.detail = typeof body['detail'] === 'string' ? body['detail'] : '';
    this.errors = Array.isArray(body['errors']) ? (body['errors'] as FieldError[]) : [];
    this.body = body;
  }

  /** What kind of failure it is, in the page's language. */
  get title(): string {
    const type = this.body['type'];
    const code = typeof type === 'string' ? type.replace('urn:voltwall:', 'problem-') : '';
    return messageText({ code, args: {}, text: this.message });
  }

  /** One sentence for the page, in its language. */
  get sentence(): string {
    const text = this.detail || this.message;
    return messageText((this.body['message'] as RenderedMessage | undefined) ?? { code: '', args: {}, text });
  }
}

export interface Call {
  method?: 'GET' | 'POST' | 'PUT' | 'DELETE';
  body?: unknown;
  ifMatch?: string;
  signal?: AbortSignal;
}

export const apiUrl = (path: string): string => `${BASE}/${path}`;

/** Call the service and return its JSON (undefined for an empty answer); throws Problem. */
export async function call<T>(path: string, options: Call = {}): Promise<T> {
  const headers: Record<string, string> = { Accept: 'application/json' };
  if (options.body !== undefined) headers['Content-Type'] = 'application/json';
  if (options.ifMatch !== undefined) headers['If-Match'] = `"${options.ifMatch}"`;
  const request: RequestInit = { method: options.method ?? 'GET', headers, cache: 'no-store' };
  if (options.body !== undefined) request.body = JSON.stringify(options.body);
  if (options.signal) request.signal = options.signal;
  let response: Response;
  try {
    response = await fetch(apiUrl(path), request);
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw new Problem(0, t('common.no_connection_service'), {
      detail:
        request.method === 'GET'
          ? t('common.service_does_not_respond')
          : t('common.service_did_not_respond_so'),
    });
  }
  if (response.ok) {
    if (response.status === 204) return undefined as T;
    return (await response.json()) as T;
  }
  throw await problemOf(response);
}

async function problemOf(response: Response): Promise<Problem> {
  try {
    const body = (await response.json()) as Record<string, unknown>;
    const title = typeof body['title'] === 'string' ? body['title'] : response.statusText;
    return new Problem(response.status, title, body);
  } catch {
    return new Problem(response.status, response.statusText || `HTTP ${response.status}`);
  }
}

export const get = <T>(path: string, signal?: AbortSignal): Promise<T> =>
  call<T>(path, signal ? { signal } : {});
export const post = <T>(path: string, body?: unknown): Promise<T> =>
  call<T>(path, body === undefined ? { method: 'POST' } : { method: 'POST', body });
export const put = <T>(path: string, body: unknown, ifMatch: string): Promise<T> =>
  call<T>(path, { method: 'PUT', body, ifMatch });
export const remove = (path: string): Promise<unknown> => call(path, { method: 'DELETE' });
export const command = (name: string, argument?: number | null): Promise<unknown> =>
  post(`commands/${name}`, argument === undefined ? {} : { argument });

/** Send a file as it is and return the answer's JSON; throws Problem. */
export async function send<T>(path: string, file: Blob): Promise<T> {
  let response: Response;
  try {
    response = await fetch(apiUrl(path), {
      method: 'POST',
      headers: { Accept: 'application/json', 'Content-Type': 'application/octet-stream' },
      body: file,
    });
  } catch {
    throw new Problem(0, t('common.upload_failed'), {
      detail: t('common.file_did_not_reach_service'),
    });
  }
  if (response.ok) return (await response.json()) as T;
  throw await problemOf(response);
}
