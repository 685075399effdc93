// SPDX-License-Identifier: Apache-2.0
import { afterEach, describe, expect, it, vi } from 'vitest';
import { FormatError, messageOf } from '../src/format/cursor';
import { fetchSource, peekHead, readAll, readParts } from '../src/format/load';
import { partsOf } from '../src/format/parts';

const PART = 700_000;

function streamOf(parts: number): ReadableStream<Uint8Array> {
  let next = 0;
  return new ReadableStream({ pull: (c) => (next < parts ? c.enqueue(new Uint8Array(PART).fill(next++)) : c.close()) });
}

describe('readParts', () => {
  it('takes all parts in their order', async () => {
    const seen: number[][] = [];
    await readParts({ name: 'f', parts: partsOf(streamOf(3)) }, (part) =>
      seen.push([part[0], part.at(-1)!, part.length]),
    );
    expect(seen).toEqual([
      [0, 0, PART],
      [1, 1, PART],
      [2, 2, PART],
    ]);
  });

  it('lets the page do something else, however large the parts are', async () => {
    let others = 0;
    const timer = setInterval(() => ++others, 1);
    const work = () => {
      for (const begin = performance.now(); performance.now() - begin < 5;);
    };
    const stream = new ReadableStream<Uint8Array>({ start: (c) => (c.enqueue(new Uint8Array(40 << 20)), c.close()) });
    await readParts({ name: 'f', parts: partsOf(stream) }, work);
    clearInterval(timer);
    expect(others).toBeGreaterThanOrEqual(5); // 200 ms of work in one part
  });

  it('lets go of a transfer that is no longer wanted', async () => {
    let cancelled = false;
    const stream = new ReadableStream<Uint8Array>({
      pull: (c) => c.enqueue(new Uint8Array(10)),
      cancel: () => void (cancelled = true),
    });
    await expect(
      readParts({ name: 'f', parts: partsOf(stream) }, () => {
        throw new Error('enough');
      }),
    ).rejects.toThrow('enough');
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

  it.each([
    ['scene.ngsplat', 'scene.ngsplat'],
    ['a/b%20c.ngsplat?x', 'b c.ngsplat'],
    ['http://[::1]:9/d', 'd'],
    ['%E0%A4%A', '%E0%A4%A'],
    ['', ''],
  ])('names %s', async (url, name) => expect((await open(url)).name).toBe(name));

  it.each(['http://', 'http://[', 'http://a:b:c/'])('says that %s is no address', async (url) => {
    await expect(open(url)).rejects.toThrow(`'${url}' is no address of a file`);
  });

  it.each([
    ['8', 8],
    ['-1', undefined],
    ['1e400', undefined],
    ['many', undefined],
    ['0.5', undefined],
  ])('takes %s for a length', async (length, size) => {
    expect((await open('f', { 'content-length': length })).size).toBe(size);
  });
});

describe('partsOf', () => {
  it('fills the same memory where the stream can', async () => {
    const left = [
      [1, 2, 3],
      [4, 5],
    ];
    const taken: number[] = [];
    const parts = partsOf(
      new ReadableStream({
        type: 'bytes',
        pull(controller) {
          const { view } = controller.byobRequest!;
          const next = left.shift();
          taken.push(view!.byteLength);
          if (next) new Uint8Array(view!.buffer).set(next);
          else controller.close();
          controller.byobRequest!.respond(next?.length ?? 0);
        },
      }),
    );
    expect([...(await parts.read())!]).toEqual([1, 2, 3]);
    expect([...(await parts.read())!]).toEqual([4, 5]);
    expect(await parts.read()).toBeUndefined();
    expect(taken).toEqual([1 << 20, 1 << 20, 1 << 20]);
  });

  it('takes what comes where the stream cannot', async () => {
    const parts = partsOf(streamOf(2));
    expect((await parts.read())!.length).toBe(PART);
    expect((await parts.read())![0]).toBe(1);
    expect(await parts.read()).toBeUndefined();
  });
});

it('what browsers say of too little memory becomes a plain message', () => {
  for (const words of ['Array buffer allocation failed', 'Invalid typed array length: 7', 'Out of memory'])
    expect(messageOf(new RangeError(words))).toBe('The memory does not suffice for this file.');
  expect(messageOf(new FormatError('the file is truncated'))).toBe('the file is truncated');
});

it.each([1, 3, 16, 100])('the head of a file is seen without taking it, in parts of %d bytes', async (size) => {
  for (const length of [0, 5, 16, 40]) {
    const bytes = Uint8Array.from({ length }, (_, i) => i);
    const stream = new ReadableStream<Uint8Array>({
      start(controller) {
        for (let at = 0; at < length; at += size) controller.enqueue(bytes.slice(at, at + size));
        controller.close();
      },
    });
    const { head, source } = await peekHead({ name: 'x', parts: partsOf(stream) });
    expect([...new Uint8Array(head)].slice(0, 16)).toEqual(Array.from(bytes.subarray(0, 16)));
    expect(new Uint8Array(await readAll(source, () => undefined))).toEqual(bytes);
  }
});
