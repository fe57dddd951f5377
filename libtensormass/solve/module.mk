# libtensormass_solve.so and .a: precomputed and hybrid models; SuiteSparse and Eigen stay out of the core.
TMS_SRC := $(sort $(wildcard libtensormass/solve/*.c libtensormass/solve/*.cpp))
LIBTMS_A := $(OUT)/lib/libtensormass_solve.a
LIBTMS_SO := $(OUT)/lib/libtensormass_solve.so.$(VERSION)
TMS_LIBS := -lcholmod -lsuitesparseconfig -lblas -lstdc++ -lpthread
LIBRARIES += $(LIBTMS_A) $(LIBTMS_SO)
$(call objects,$(TMS_SRC)): INCLUDES += -I/usr/include/suitesparse -isystem /usr/include/eigen3
# Eigen's templates: lines alone for a debugger, and their undefined behaviour is not ours to look for: half of the time they take to compile.
$(call objects,$(filter %.cpp,$(TMS_SRC))): BASE_CXXFLAGS += $(if $(SAN),-fno-sanitize=undefined,-g1)
$(LIBTMS_A): $(call objects,$(TMS_SRC))
	$(archive)
$(LIBTMS_SO): $(call objects,$(TMS_SRC)) $(LIBTM_SO)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CXX) $(SAN) -shared -Wl,-soname,libtensormass_solve.so.$(SOVERSION) $(if $(SAN),,-Wl,--no-undefined) $(ORIGIN) -o $@ $(call objects,$(TMS_SRC)) -L$(OUT)/lib -ltensormass $(TMS_LIBS) -lm
	$(Q)ln -sf $(@F) $(@D)/libtensormass_solve.so.$(SOVERSION) && ln -sf libtensormass_solve.so.$(SOVERSION) $(@D)/libtensormass_solve.so
# The same as a module that tm-sim opens when a scene says precomputed or hybrid; the core's functions come from the program.
$(eval $(call module,solve,$(TMS_SRC),,$(TMS_LIBS)))
