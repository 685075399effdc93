gs_add_appearance(nasg Nasg)
gs_add_appearance(nasgabor Nasgabor)
