# SPDX-License-Identifier: Apache-2.0
gs_add_appearance(nasg Nasg)
gs_add_appearance(nasgabor Nasgabor)
