$(eval $(call test,tests/view/test_skin.c,$(call objects,$(addprefix apps/view/,fairing.c picture.c reference.c rim.c sides.c skin.c)),))
$(eval $(call test,tests/view/test_fairing.c,$(call objects,$(addprefix apps/view/,fairing.c picture.c reference.c rim.c sides.c skin.c)),))
$(eval $(call test,tests/view/test_controls.c,$(call objects,apps/play/controls.c apps/view/camera.c) $(LIBHRT_A),))
$(eval $(call test,tests/view/test_marks.c,$(call objects,$(addprefix apps/view/,camera.c layout.c marks.c marks_find.c picture.c shapes.c)),))
