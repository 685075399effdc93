// SPDX-License-Identifier: Apache-2.0

export type Vector = [number, number, number];
