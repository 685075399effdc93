# SPDX-License-Identifier: Apache-2.0
gs_add_appearance(toy Toy)
