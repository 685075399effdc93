// SPDX-License-Identifier: Apache-2.0
import { afterEach, describe, expect, it, vi } from 'vitest';
import { fetchSource, readAll } from '../src/format/load';

const PART = 700_000;

function streamOf(parts: number): ReadableStream<Uint8Array> {
  let next = 0;
  return new ReadableStream({ pull: (c) => (next < parts ? c.enqueue(new Uint8Array(PART).fill(next++)) : c.close()) });
}

describe('readAll', () => {
  it.each([['exactly', 3 * PART], ['not', undefined], ['as too little', PART], ['as too much', 9 * PART]])('takes all parts of a file whose size is %s known', async (_, size) => {
    const seen: number[] = [];
    const bytes = new Uint8Array(await readAll({ name: 'f', size, stream: streamOf(3) }, (n) => seen.push(n)));
    expect(bytes.length).toBe(3 * PART);
    expect([0, 1, 2].map((i) => [bytes[i * PART], bytes[(i + 1) * PART - 1]])).toEqual([[0, 0], [1, 1], [2, 2]]);
    expect(seen).toEqual([PART, 2 * PART, 3 * PART]);
  });

  it('says so where memory does not suffice', async () => {
    await expect(readAll({ name: 'f', size: 2 ** 52, stream: streamOf(1) }, () => undefined)).rejects.toThrow(/cannot give 4503599627370496 bytes/);
  });

  it('lets go of a transfer that is no longer wanted', async () => {
    let cancelled = false;
    const stream = new ReadableStream<Uint8Array>({ pull: (c) => c.enqueue(new Uint8Array(10)), cancel: () => void (cancelled = true) });
    await expect(readAll({ name: 'f', stream }, () => { throw new Error('enough'); })).rejects.toThrow('enough');
    expect(cancelled).toBe(true);
  });
});

describe('fetchSource', () => {
  afterEach(() => void vi.unstubAllGlobals());
  const open = (url: string, headers: Record<string, string> = {}) => {
    vi.stubGlobal('location', { href: 'http://127.0.0.1:8000/?model=x' });
    vi.stubGlobal('fetch', () => Promise.resolve(new Response('the file', { headers })));
    return fetchSource(url, new AbortController().signal);
  };

  it.each([['scene.ngsplat', 'scene.ngsplat'], ['a/b%20c.ngsplat?x', 'b c.ngsplat'], ['http://[::1]:9/d', 'd'], ['%E0%A4%A', '%E0%A4%A'], ['', '']])(
    'names %s', async (url, name) => expect((await open(url)).name).toBe(name));

  it.each(['http://', 'http://[', 'http://a:b:c/'])('says that %s is no address', async (url) => {
    await expect(open(url)).rejects.toThrow(`'${url}' is no address of a file`);
  });

  it.each([['8', 8], ['-1', undefined], ['1e400', undefined], ['many', undefined], ['0.5', undefined]])('takes %s for a length', async (length, size) => {
    expect((await open('f', { 'content-length': length })).size).toBe(size);
  });
});
