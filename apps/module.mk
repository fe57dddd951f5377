# The programs. Shared archives: libapp (common parts of programs that run scenes), libsim (controllers in lockstep and messages), libreplay (replay of samples).
# None links a heavy library: those are in modules.
$(call library,app,$(call files,apps/common/*.c))
$(call library,sim,$(filter-out apps/sim/main.c,$(call files,apps/sim/*.c)))
$(call library,replay,$(call files,apps/studies/replay/*.c))
$(call program,tm-mesh,$(call files,apps/mesh/*.c),tensormass_scene $(APP_LIBS) tensormass,-lcjson)
$(call program,tm-scene,$(call files,apps/scene/*.c),$(SCENE_LIBS),-lyaml -lcjson)
$(call program,tm-sim,apps/sim/main.c,$(SIM_LIBS),-lyaml -lcjson)
$(call program,tm-accuracy,$(call files,apps/studies/accuracy/*.c),replay $(SIM_LIBS),-lyaml -lcjson)
$(call program,tm-evaluate,$(call files,apps/studies/evaluate/*.c),replay $(SIM_LIBS),-lyaml -lcjson)
$(call program,tm-stability,$(call files,apps/studies/stability/*.c),$(APP_LIBS) tensormass $(DEVICE_LIBS),-lcjson)

# tm-view and tm-play, and the modules they open: osmesa draws (opengl if there is a window), window is tm-play's window, lcm receives from the network.
VIEW_SRC := camera message_source font inbox inner_regions message_validation layout marks_find output overlay picture regions scene_marks scene_decoration picture_renderer
VIEW_LIBS := $(SCENE_LIBS) hrt_io hrt lcm_types
$(call program,tm-view,$(patsubst %,apps/view/%.c,$(VIEW_SRC) main options),$(VIEW_LIBS),$$(call pkg_libs,libpng) -lyaml -lcjson)
$(call program,tm-play,apps/play/main.c apps/play/controls.c $(patsubst %,apps/view/%.c,$(VIEW_SRC)),$(VIEW_LIBS),$$(call pkg_libs,libpng) -lyaml -lcjson)
RENDER_SRC := $(patsubst %,apps/view/%.c,camera fairing marks marks_find picture reference render render_make cut_outline shapes surface_smoothing)
$(call module,osmesa,$(RENDER_SRC) apps/view/context_osmesa.c,,$$(call pkg_libs,osmesa))
$(call module,opengl,$(RENDER_SRC) apps/view/context_window.c,,$$(call pkg_libs,sdl2 gl))
$(call module,window,apps/play/window.c,,$$(call pkg_libs,sdl2))
$(call objects,apps/view/context_window.c apps/play/window.c): CFLAGS_EXTRA += $(call pkg_cflags,sdl2)

# tm-precompute, and with Open MPI (MPI=1, the default if mpicc exists) tm-precompute-mpi, whose ranks share one factor with MUMPS (MUMPS=1, the default if its header exists).
$(call program,tm-precompute,apps/precompute/main.c apps/precompute/ranks_alone.c,$(SCENE_LIBS),-lyaml -lcjson)
MPI ?= $(if $(shell command -v mpicc),1,0)
ifeq ($(MPI),1)
MUMPS ?= $(if $(shell $(CC) -include dmumps_c.h -E -x c /dev/null 2>/dev/null | grep -m1 DMUMPS_STRUC_C),1,0)
MUMPS := $(MUMPS)
MPI_SRC := apps/precompute/ranks_mpi.c apps/precompute/distributed_$(if $(filter 1,$(MUMPS)),mumps,none).c
$(call objects,$(MPI_SRC)): INCLUDES += $(call pkg_cflags,ompi-c)
$(call program,tm-precompute-mpi,apps/precompute/main.c $(MPI_SRC),$(SCENE_LIBS),-lyaml -lcjson $$(call pkg_libs,ompi-c) $(if $(filter 1,$(MUMPS)),-ldmumps))
# Linked again if MUMPS was added or removed since the last build; a missing .SECONDARY file alone triggers nothing.
MUMPS_STAMP := $(OUT)/obj/apps/precompute/mumps
ifneq ($(if $(wildcard $(MUMPS_STAMP)),$(file <$(MUMPS_STAMP))),$(MUMPS))
$(shell mkdir -p $(dir $(MUMPS_STAMP)) && echo $(MUMPS) >$(MUMPS_STAMP))
endif
$(OUT)/bin/tm-precompute-mpi: $(MUMPS_STAMP)
endif

# Python scripts and their library, run from a prefix as from here. tm-session's scripts are in the same folder.
$(call script,bin/tm-organ,apps/organ/tm_organ.py)
$(call script,lib/tensormass/organ/organ_bodies.py,apps/organ/organ_bodies.py)
$(call script,bin/tm-study,apps/study/tm_study.py)
$(call script,bin/tm-fit,apps/fit/tm_fit.py)
$(foreach f,fit_page.py mesh_check.py model.py statistics_of_fit.py swing.py trials.py,$(call script,lib/tensormass/fit/$(f),apps/fit/$(f)))
$(call script,bin/tm-session,apps/session/tm_session.py)
$(foreach f,session.py netns.sh display.py,$(call script,lib/tensormass/session/$(f),apps/demo/$(f)))

#: make demo                   the ring in real time and in lockstep: pictures, video, force plot, figures in build/demo
#: make play                   a window: mouse and keys move the instruments (PLAY_ARGS='--record session.lcm')
#: make spy                    lcm-spy on the session that runs
DEMO_SCENE ?= apps/scenes/liver-cut.yaml
DEMO_CAMERA ?= --azimuth -72 --elevation 32 --zoom 1.15
PLAY_SCENE ?= $(DEMO_SCENE)
demo:
	@apps/demo/opening.sh $(OUT) $(DEMO_SCENE)
	$(call ready,build demo,all venv)
	@$(VENV)/bin/python apps/demo/demo.py --build $(OUT) --scene $(DEMO_SCENE) --camera='$(DEMO_CAMERA)' $(DEMO_ARGS)
play:
	@[ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] || { echo "play: no display (neither DISPLAY nor WAYLAND_DISPLAY is set); run it on a desktop or over ssh -X, or use make demo, which needs none" >&2; exit 2; }
	$(call ready,build demo,all venv)
	@$(VENV)/bin/python apps/play/play.py --build $(OUT) --scene $(PLAY_SCENE) $(PLAY_ARGS) -- $(DEMO_CAMERA) $(PLAY_WINDOW)
spy:
	@OUT=$(OUT) apps/demo/spy.sh

#: make organ IMAGE= ORGAN_ARGS=  from a segmented image, a surface or a mesh to an organ that is felt: build/organ/
#: make accuracy               what accuracy costs in time: build/accuracy/index.html (QUICK=1: the short form)
#: make evaluate               extrapolation errors: build/evaluate/index.html (QUICK=1: the short form)
#: make stability              every hard case and its verdict: build/stability/index.html (QUICK=1: the short form)
organ:
	@$(if $(IMAGE),,echo "make organ: no IMAGE; make organ IMAGE=seg.nii.gz (or .stl, .msh; tm-organ --help)" >&2; exit 2)
	$(call ready,build,programs)
	@$(OUT)/bin/tm-organ '$(IMAGE)' -o $(OUT)/organ $(ORGAN_ARGS)
#: make reality               what was measured beside what is simulated: build/reality/index.html (QUICK=1: the short form; REALITY_ARGS='--predict 0.3': another load)
reality:
	$(call ready,build,venv programs)
	TM_CC=$(CC) TM_FLAGS='$(OPT) -ffp-contract=off' $(VENV)/bin/python apps/studies/reality/reality.py -o $(OUT)/reality --sim $(OUT)/bin/tm-sim $(if $(QUICK),--quick) $(REALITY_ARGS)
# $(call draw,STUDY,FIGURES,OPTIONS): draws the page of a study.
draw = TM_CC=$(CC) TM_FLAGS='$(OPT) -ffp-contract=off' $(VENV)/bin/python apps/studies/$(1)/page.py $(OUT)/$(1)/$(2).json -o $(OUT)/$(1) $(3)
accuracy:
	$(call ready,build,venv programs)
	@mkdir -p $(OUT)/accuracy
	$(OUT)/bin/tm-accuracy $(if $(QUICK),--quick) --json $(OUT)/accuracy/figures.json
	$(call draw,accuracy,figures,$(if $(wildcard $(OUT)/evaluate/rates.json),--rates $(OUT)/evaluate/rates.json))
# Figures of tm-stability, shown on the page too.
EVALUATE_CASES := spike-1mm spike-10mm spike-50mm spike-100mm tears-away each-its-own lump-20 replays doubled reordered loss-10 delay-50 two-sims
evaluate:
	$(call ready,build,venv programs)
	@mkdir -p $(OUT)/evaluate
	$(OUT)/bin/tm-evaluate --study $(if $(QUICK),--quick) $(EVALUATE_ARGS) --json $(OUT)/evaluate/figures.json
	$(OUT)/bin/tm-stability $(if $(QUICK),--quick) $(EVALUATE_CASES:%=--case %) --quiet --json $(OUT)/evaluate/torture.json || [ $$? -eq 1 ]
	$(call draw,evaluate,figures,--torture $(OUT)/evaluate/torture.json)
stability:
	$(call ready,build,venv programs)
	@mkdir -p $(OUT)/stability
	$(OUT)/bin/tm-stability $(if $(QUICK),--quick) --json $(OUT)/stability/verdicts.json; code=$$?; \
	$(call draw,stability,verdicts,--fuzz $(BUILD)/fuzz/fuzz.json --sanitize $(BUILD)/sanitize.json) && exit $$code

# image.so: images with ITK and GDCM (part of ITK's package), tetrahedra with CGAL (GPL), for tm-mesh image and fill. Optional: nothing else depends on it.
#: make image                  the module of tm-mesh image (ITK, CGAL: 47 MB of packages, installed if missing)
IMAGE_SRC := $(call files,apps/image/*.cpp)
newest = $(firstword $(wildcard /usr/include/$(1)-*) /usr/include/$(1))
# -O1 compiles these headers in half the time, and the mesher is as fast.
$(call objects,$(IMAGE_SRC)): BASE_CXXFLAGS += $(if $(filter release,$(config)),-O1 -g1) -isystem $(call newest,ITK)
$(call objects,apps/image/dicom.cpp): BASE_CXXFLAGS += -isystem $(call newest,gdcm)
# CGAL's own warning, in its header repair_self_intersections.h
$(call objects,apps/image/surface.cpp): BASE_CXXFLAGS += -Wno-maybe-uninitialized
IMAGE_LIBS = $(patsubst %,-l%-$(patsubst ITK-%,%,$(notdir $(call newest,ITK))),ITKIONIFTI ITKIONRRD ITKIOMeta ITKIOImageBase ITKCommon itksys) -lgdcmMSFF -lgdcmDSED -lgdcmDICT -lgdcmCommon -lz -lgmp -lmpfr
$(eval $(call module_rule,image,$(IMAGE_SRC),,$$(IMAGE_LIBS)))
# Once built, tests rebuild it from its sources: an outdated one has another interface and hangs.
ifneq ($(wildcard $(OUT)/lib/tensormass/image.so),)
tests: $(OUT)/lib/tensormass/image.so
endif
image:
	$(call ready,build image,$(OUT)/lib/tensormass/image.so)

# The generated meshes. 1k and 10k are committed (tests compare them with the generator's output).
#: make meshes               the generated meshes of 50,000 tetrahedra, into build/meshes/
MESHES_DIR ?= $(OUT)/meshes
MESH_GENERATOR := $(OUT)/obj/apps/mesh/generate
$(call executable,obj/apps/mesh/generate,$(call files,apps/mesh/generator/*.c) $(patsubst %,apps/mesh/%.c,mesh_builder bisect improve isosurface_stuffing))
$(MESHES_DIR)/liver_18k.msh $(MESHES_DIR)/gallbladder_2k.msh: $(MESHES_DIR)/%k.msh: $(MESH_GENERATOR)
	@mkdir -p $(@D)
	$(MESH_GENERATOR) $(subst _, ,$*)000 $(basename $@)
meshes: $(foreach s,block cylinder liver,$(MESHES_DIR)/$(s)_50k.msh)
$(MESHES_DIR)/%_50k.msh: $(MESH_GENERATOR)
	@mkdir -p $(@D)
	$(MESH_GENERATOR) $* 50000 $(basename $@)
#: make cholecystectomy       a gallbladder is drawn off its bed: log, film with its forces and a strip of pictures: build/cholecystectomy (FINE=1: 20,676 tetrahedra, two threads, single precision: build/cholecystectomy-fine)
CHOLECYSTECTOMY := $(OUT)/cholecystectomy$(if $(FINE),-fine)
CHOLECYSTECTOMY_MESHES := $(if $(FINE),$(MESHES_DIR)/liver_18k.msh $(MESHES_DIR)/gallbladder_2k.msh,meshes/liver_10k.msh meshes/gallbladder_1k.msh)
# Real time on two cores in all but the frames after some cuts (docs/bodies-results.md).
CHOLECYSTECTOMY_FINE := -e 's|11,198|20,676|' -e 's|^tissue:|threads: 2\ntissue:\n  precision: single|' -e 's|step: 0.8 ms|step: 1 ms|'
cholecystectomy: $(if $(FINE),$(CHOLECYSTECTOMY_MESHES))
	$(call ready,build,programs)
	@mkdir -p $(CHOLECYSTECTOMY)
	sed -e 's#../../meshes/liver_10k.msh#$(abspath $(word 1,$(CHOLECYSTECTOMY_MESHES)))#' -e 's#../../meshes/gallbladder_1k.msh#$(abspath $(word 2,$(CHOLECYSTECTOMY_MESHES)))#' $(if $(FINE),$(CHOLECYSTECTOMY_FINE)) apps/scenes/cholecystectomy.yaml > $(CHOLECYSTECTOMY)/scene.yaml
	$(OUT)/bin/tm-sim $(CHOLECYSTECTOMY)/scene.yaml --lockstep --record $(CHOLECYSTECTOMY)/log --csv $(CHOLECYSTECTOMY)/force.csv --json $(CHOLECYSTECTOMY)/figures.json
	$(OUT)/bin/tm-view $(CHOLECYSTECTOMY)/log --scene $(CHOLECYSTECTOMY)/scene.yaml --size 640x480 --azimuth -130 --elevation 8 --zoom 1.6 --shift -0.04,0.27 --no-supports --video $(CHOLECYSTECTOMY)/video.mp4
	ffmpeg -v error -y -i $(CHOLECYSTECTOMY)/video.mp4 -vf fps=1,scale=480:-1,tile=4x2 -frames:v 1 $(CHOLECYSTECTOMY)/strip.png
# Generates the committed meshes again. liver_cut is finer where the demo cuts, the front margin of the left lobe, and renumbered:
# refining numbers new vertices last, wherever they are.
CUT_BOX := 35mm,-70mm,-20mm,75mm,-35mm,60mm
meshes-committed: $(MESH_GENERATOR) $(OUT)/bin/tm-mesh
	for s in block cylinder liver; do $(MESH_GENERATOR) $$s 1000 meshes/$${s}_1k && $(MESH_GENERATOR) $$s 10000 meshes/$${s}_10k || exit 1; done
	$(MESH_GENERATOR) gallbladder 1000 meshes/gallbladder_1k
	$(OUT)/bin/tm-mesh refine --box $(CUT_BOX) --size 8mm --fibres meshes/liver_10k.fibres.csv --write-fibres $(OUT)/refined.fibres.csv meshes/liver_10k.msh -o $(OUT)/refined.msh
	$(OUT)/bin/tm-mesh renumber --fibres $(OUT)/refined.fibres.csv --write-fibres meshes/liver_cut.fibres.csv $(OUT)/refined.msh -o meshes/liver_cut.msh
