gs_add_appearance(sv Sv)
