/* Constants of nonlinear laws from the cited papers, and up to which stretch they hold. */
#include "tissues.h"

#include <stddef.h>

/* Terms of a paper's law that no law here has are omitted; the stretch states up to where they are less than a tenth
 * of the stress. E = 3 mu. */
static const tissue_large rows[] = {
    {"myocardium", "benchmark",
     "{lambda_T: 100 kPa, mu_T: 2 kPa, lambda_L: 100 kPa, mu_L: 4 kPa, beta: 4 kPa, law: fung, C: 2 kPa, stretch: 1.2}",
     1.2,
     "Guccione's law, C 2 kPa, bf 8, bt 2, bfs 4, of the benchmark of Land 2015, Proc R Soc A 471:20150641; bulk modulus chosen"},
    {"myocardium_ho", "dog",
     "{young: 6.84 kPa, poisson: 0.45, law: holzapfel, k1: 1.685 kPa, k2: 15.779, stretch: 1.2}", 1.05,
     "Holzapfel and Ogden 2009, Phil Trans R Soc A 367:3445, table 1, a 2.280, af 1.685 kPa, bf 15.779; exp of I1 (b 9.726) left out"},
    {"myocardium_human", "human",
     "{young: 404 Pa, poisson: 0.45, law: holzapfel, k1: 3.176 kPa, k2: 4.7435, stretch: 1.2}", 1.2,
     "living hearts, along the fibres; Gao 2015, J Eng Math 95:231, table 5, a 134.8, af 3176 Pa, bf 4.7435, cited by a public table of tissues; exp of I1 (b 3.243) and sheets (as 543 Pa) left out"},
    {"aorta_media", "human", "{young: 101.2 kPa, poisson: 0.45, law: neo-hooke}", 1.05,
     "abdominal, tangent at rest around the vessel 101.2, along it 107.3 kPa: Teng 2015, Ann Biomed Eng 43:2745, cited by a public table of tissues; how it stiffens is not in it"},
    {"artery_media", "rabbit",
     "{young: 9 kPa, poisson: 0.45, law: holzapfel, k1: 2.3632 kPa, k2: 0.8393, stretch: 1.6}", 1.6,
     "Holzapfel, Gasser and Ogden 2000, J Elast 61:1, carotid media, c 3.0 kPa, k1, k2, cited by two finite-element codes; one of its two families of fibres, 29 degrees from the circumference"},
    {"artery_adventitia", "rabbit",
     "{young: 0.9 kPa, poisson: 0.45, law: holzapfel, k1: 562 Pa, k2: 0.7112, stretch: 1.6}", 1.6,
     "Holzapfel, Gasser and Ogden 2000, J Elast 61:1, carotid adventitia, c 0.3 kPa, k1, k2, cited by two finite-element codes; one of its two families of fibres, 62 degrees from the circumference"},
    {"liver", "human", "{young: 5.5 kPa, poisson: 0.45, law: neo-hooke}", 1.05,
     "429 healthy people, transient elastography, 5.49 kPa: Roulot 2008, J Hepatol 48:606; a modulus of small strains: how liver stiffens is not in it"},
    {"kidney", "human", "{young: 5 kPa, poisson: 0.45, law: neo-hooke}", 1.05,
     "renal cortex, shear-wave elastography, 5.0 kPa: Arda 2011, AJR 197:532; a modulus of small strains: how kidney stiffens is not in it"},
    {"fat", "human", "{young: 1.6 kPa, poisson: 0.45, law: fung, C: 197 Pa, stretch: 1.4}", 1.3,
     "subcutaneous, tangent 1.6 kPa at rest and 11.7 kPa pulled by 0.3, from which C follows: Alkhouli 2013, Am J Physiol Endocrinol Metab 305:E1427, cited by a public table of tissues"},
    {"fat_omental", "human", "{young: 2.9 kPa, poisson: 0.45, law: fung, C: 273 Pa, stretch: 1.4}", 1.3,
     "tangent 2.9 kPa at rest and 32 kPa pulled by 0.3, from which C follows: Alkhouli 2013, Am J Physiol Endocrinol Metab 305:E1427, cited by a public table of tissues"},
    {"fat_fibred", "human",
     "{young: 900 Pa, poisson: 0.45, law: holzapfel, k1: 1.6 kPa, k2: 47.3, dispersion: 0.09, fibre_stretch: 1.2}", 1.2,
     "abdominal; Sommer 2013, Acta Biomater 9:9036, table 2, c 0.15 kPa, k1 0.8 kPa without the half of this law, k2, kappa, cited by a finite-element code"},
    {"muscle_across", "animal", "{young: 54.5 kPa, poisson: 0.45, law: fung, C: 774 Pa, stretch: 1.2}", 1.07,
     "Martins 1998, Comput Methods Appl Mech Eng 151:419, c 0.387 kPa, b 23.46 of c (exp(b (I1 - 3)) - 1), cited by a finite-element code; to second order; fibres left out"},
    {"skin", "human", "{young: 56.4 kPa, poisson: 0.45, law: neo-hooke}", 1.04,
     "Hendriks 2005 as in Xu and Lu 2011, c0 9.4 kPa; c1 82 kPa (I1 - 3)(I2 - 3) left out"},
    {"brain_cortex", "human", "{young: 4.97 kPa, poisson: 0.45, law: fung, C: 104 Pa, stretch: 1.2}", 1.1,
     "fitted by make reality to pressed cubes of Budday 2017, Acta Biomater 48:319; pulled, they are two thirds softer, sheared within 17 %"},
    {"brain_cortex_mr", "human", "{young: 5.65 kPa, poisson: 0.45, law: mooney-rivlin, second: 0.999}", 1.1,
     "one fit to pressed, pulled and sheared cubes: Peirlinck 2024, Comput Methods Appl Mech Eng 418:116534, table 1 by its input files, c1 0.001, c2 0.941 kPa; make reality: pressed by 0.1 24 % off, pulled 38 %, sheared by 0.2 50 %"},
    {"ecoflex_00_30", "silicone", "{young: 48.7 kPa, poisson: 0.45, law: neo-hooke, stretch: 3}", 3.0,
     "fitted by make reality to a strip of Marechal 2021, Soft Robotics 8:284, within 6 %"},
    {"ecoflex_00_50", "silicone", "{young: 67.2 kPa, poisson: 0.45, law: neo-hooke, stretch: 3}", 3.0,
     "fitted by make reality to a strip of Marechal 2021, Soft Robotics 8:284, within 4 % from stretch 1.25 on"},
    {"ecoflex_00_10", "silicone", "{young: 24.3 kPa, poisson: 0.45, law: neo-hooke, stretch: 2.5}", 2.5,
     "fitted by make reality to a strip of Marechal 2021, Soft Robotics 8:284, within 9 % from stretch 1.25 on"},
    {"dragon_skin_10_medium", "silicone", "{young: 149 kPa, poisson: 0.45, law: neo-hooke}", 1.6,
     "fitted by make reality to a strip of Marechal 2021, Soft Robotics 8:284, within 11 %; stiffens beyond"},
    {"dragon_skin_10", "silicone", "{young: 217 kPa, poisson: 0.45, law: neo-hooke}", 1.1,
     "fitted by make reality to the beam of Dubied 2022, IEEE Robot Autom Lett 7:5015, relaxed"},
    {"ecoflex_00_10_thinned", "silicone", "{young: 15.5 kPa, poisson: 0.45, law: neo-hooke}", 1.1,
     "with 50 % thinner, 15.52 +- 0.40 kPa (100 %: 5.42 +- 0.77): phantom-material-database, Dawood 2021, CC BY 4.0"},
};
enum { ROWS = sizeof rows / sizeof *rows };

const tissue_large *tissue_large_row(int index) { return index >= 0 && index < ROWS ? rows + index : NULL; }
