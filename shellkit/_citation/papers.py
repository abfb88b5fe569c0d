"""The papers behind the parts, as BibTeX. A part names its own in the class attribute `papers`, and
`InverseProblem.citation` gathers them."""

AHARONI_2014 = """@article{aharoni2014geometry,
    author = {Aharoni, Hillel and Sharon, Eran and Kupferman, Raz},
    title = {Geometry of thin nematic elastomer sheets},
    journal = {Physical Review Letters},
    volume = {113},
    pages = {257801},
    year = {2014},
}"""

BARROW_1977 = """@inproceedings{barrow1977parametric,
    author = {Barrow, Harry G. and Tenenbaum, Jay M. and Bolles, Robert C. and Wolf, Helen C.},
    title = {Parametric correspondence and chamfer matching: two new techniques for image matching},
    booktitle = {Proceedings of the 5th International Joint Conference on Artificial Intelligence},
    pages = {659--663},
    year = {1977},
}"""

BESL_1992 = """@article{besl1992method,
    author = {Besl, Paul J. and McKay, Neil D.},
    title = {A method for registration of 3-{D} shapes},
    journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
    volume = {14},
    number = {2},
    pages = {239--256},
    year = {1992},
}"""

BRADBURY_2018 = """@software{bradbury2018jax,
    author = {Bradbury, James and Frostig, Roy and Hawkins, Peter and Johnson, Matthew James and Leary, Chris and
        Maclaurin, Dougal and Necula, George and Paszke, Adam and VanderPlas, Jake and Wanderman-Milne, Skye and
        Zhang, Qiao},
    title = {{JAX}: composable transformations of {P}ython+{N}um{P}y programs},
    url = {https://github.com/jax-ml/jax},
    year = {2018},
}"""

CHARON_2013 = """@article{charon2013varifold,
    author = {Charon, Nicolas and Trouv{\\'e}, Alain},
    title = {The varifold representation of nonoriented shapes for diffeomorphic registration},
    journal = {SIAM Journal on Imaging Sciences},
    volume = {6},
    number = {4},
    pages = {2547--2580},
    year = {2013},
}"""

CHEN_2008 = """@article{chen2008cholmod,
    author = {Chen, Yanqing and Davis, Timothy A. and Hager, William W. and Rajamanickam, Sivasankaran},
    title = {Algorithm 887: {CHOLMOD}, supernodal sparse {C}holesky factorization and update/downdate},
    journal = {ACM Transactions on Mathematical Software},
    volume = {35},
    number = {3},
    pages = {22},
    year = {2008},
}"""

CHEN_2018 = """@article{chen2018physical,
    author = {Chen, Hsiao-Yu and Sastry, Arnav and van Rees, Wim M. and Vouga, Etienne},
    title = {Physical simulation of environmentally induced thin shell deformation},
    journal = {ACM Transactions on Graphics},
    volume = {37},
    number = {4},
    pages = {146},
    year = {2018},
}"""

CLAUSSEN = """@software{claussen_triangulax,
    author = {Claussen, Nikolas},
    title = {triangulax: {JAX}-compatible triangular meshes and triangular-mesh-based simulations},
    url = {https://pypi.org/project/triangulax},
}"""

COHEN_STEINER_2003 = """@inproceedings{cohensteiner2003restricted,
    author = {Cohen-Steiner, David and Morvan, Jean-Marie},
    title = {Restricted {D}elaunay triangulations and normal cycle},
    booktitle = {Proceedings of the 19th Symposium on Computational Geometry},
    year = {2003},
}"""

DEMMEL_1999 = """@article{demmel1999supernodal,
    author = {Demmel, James W. and Eisenstat, Stanley C. and Gilbert, John R. and Li, Xiaoye S. and Liu, Joseph W. H.},
    title = {A supernodal approach to sparse partial pivoting},
    journal = {SIAM Journal on Matrix Analysis and Applications},
    volume = {20},
    number = {3},
    pages = {720--755},
    year = {1999},
}"""

EFRATI_2009 = """@article{efrati2009elastic,
    author = {Efrati, Efi and Sharon, Eran and Kupferman, Raz},
    title = {Elastic theory of unconstrained non-{E}uclidean plates},
    journal = {Journal of the Mechanics and Physics of Solids},
    volume = {57},
    number = {4},
    pages = {762--775},
    year = {2009},
}"""

GILL_1981 = """@book{gill1981practical,
    author = {Gill, Philip E. and Murray, Walter and Wright, Margaret H.},
    title = {Practical Optimization},
    publisher = {Academic Press},
    year = {1981},
}"""

GRINSPUN_2003 = """@inproceedings{grinspun2003discrete,
    author = {Grinspun, Eitan and Hirani, Anil N. and Desbrun, Mathieu and Schr{\\"o}der, Peter},
    title = {Discrete shells},
    booktitle = {Proceedings of the 2003 ACM SIGGRAPH/Eurographics Symposium on Computer Animation},
    year = {2003},
}"""

HESTENES_1952 = """@article{hestenes1952methods,
    author = {Hestenes, Magnus R. and Stiefel, Eduard},
    title = {Methods of conjugate gradients for solving linear systems},
    journal = {Journal of Research of the National Bureau of Standards},
    volume = {49},
    number = {6},
    pages = {409--436},
    year = {1952},
}"""

JONES_1999 = """@book{jones1999mechanics,
    author = {Jones, Robert M.},
    title = {Mechanics of composite materials},
    edition = {2},
    publisher = {Taylor and Francis},
    year = {1999},
}"""

KABSCH_1976 = """@article{kabsch1976solution,
    author = {Kabsch, Wolfgang},
    title = {A solution for the best rotation to relate two sets of vectors},
    journal = {Acta Crystallographica Section A},
    volume = {32},
    number = {5},
    pages = {922--923},
    year = {1976},
}"""

KALTENMARK_2017 = """@inproceedings{kaltenmark2017general,
    author = {Kaltenmark, Ir{\\`e}ne and Charlier, Benjamin and Charon, Nicolas},
    title = {A general framework for curve and surface comparison and registration with oriented varifolds},
    booktitle = {IEEE Conference on Computer Vision and Pattern Recognition},
    pages = {4580--4589},
    year = {2017},
}"""

KIDGER_2021 = """@inproceedings{kidger2021equinox,
    author = {Kidger, Patrick and Garcia, Cristian},
    title = {{E}quinox: neural networks in {JAX} via callable {P}y{T}rees and filtered transformations},
    booktitle = {Differentiable Programming workshop at Neural Information Processing Systems},
    year = {2021},
}"""

LE_DRET_1995 = """@article{ledret1995nonlinear,
    author = {Le Dret, Herv{\\'e} and Raoult, Annie},
    title = {The nonlinear membrane model as variational limit of nonlinear three-dimensional elasticity},
    journal = {Journal de Math{\\'e}matiques Pures et Appliqu{\\'e}es},
    volume = {74},
    pages = {549--578},
    year = {1995},
}"""

MAGISANO_2017 = """@article{magisano2017improve,
    author = {Magisano, Domenico and Leonetti, Leonardo and Garcea, Giovanni},
    title = {How to improve efficiency and robustness of the {N}ewton method in geometrically non-linear structural
        problem discretized via displacement-based finite elements},
    journal = {Computer Methods in Applied Mechanics and Engineering},
    volume = {313},
    pages = {986--1005},
    year = {2017},
}"""

MEYER_2003 = """@incollection{meyer2003discrete,
    author = {Meyer, Mark and Desbrun, Mathieu and Schr{\\"o}der, Peter and Barr, Alan H.},
    title = {Discrete differential-geometry operators for triangulated 2-manifolds},
    booktitle = {Visualization and Mathematics III},
    year = {2003},
}"""

NOCEDAL_2006 = """@book{nocedal2006numerical,
    author = {Nocedal, Jorge and Wright, Stephen J.},
    title = {Numerical optimization},
    edition = {2},
    publisher = {Springer},
    year = {2006},
}"""

PIPKIN_1986 = """@article{pipkin1986relaxed,
    author = {Pipkin, Allen C.},
    title = {The relaxed energy density for isotropic elastic membranes},
    journal = {IMA Journal of Applied Mathematics},
    volume = {36},
    pages = {85--99},
    year = {1986},
}"""

POTTMANN_2006 = """@article{pottmann2006geometry,
    author = {Pottmann, Helmut and Huang, Qi-Xing and Yang, Yong-Liang and Hu, Shi-Min},
    title = {Geometry and convergence analysis of algorithms for registration of {3D} shapes},
    journal = {International Journal of Computer Vision},
    volume = {67},
    number = {3},
    pages = {277--296},
    year = {2006},
}"""

RADER_2024 = """@article{rader2024optimistix,
    author = {Rader, Jason and Lyons, Terry and Kidger, Patrick},
    title = {{O}ptimistix: modular optimisation in {JAX} and {E}quinox},
    journal = {arXiv:2402.09983},
    year = {2024},
}"""

SCHENK_2004 = """@article{schenk2004solving,
    author = {Schenk, Olaf and G{\\"a}rtner, Klaus},
    title = {Solving unsymmetric sparse systems of linear equations with {PARDISO}},
    journal = {Future Generation Computer Systems},
    volume = {20},
    number = {3},
    pages = {475--487},
    year = {2004},
}"""

SCHWEIZERHOF_1984 = """@article{schweizerhof1984displacement,
    author = {Schweizerhof, Karl and Ramm, Ekkehard},
    title = {Displacement dependent pressure loads in nonlinear finite element analyses},
    journal = {Computers and Structures},
    volume = {18},
    number = {6},
    pages = {1099--1114},
    year = {1984},
}"""

SITZMANN_2020 = """@inproceedings{sitzmann2020implicit,
    author = {Sitzmann, Vincent and Martel, Julien N. P. and Bergman, Alexander W. and Lindell, David B. and
        Wetzstein, Gordon},
    title = {Implicit neural representations with periodic activation functions},
    booktitle = {Advances in Neural Information Processing Systems 33},
    year = {2020},
}"""

STEIGMANN_1990 = """@article{steigmann1990tension,
    author = {Steigmann, David J.},
    title = {Tension-field theory},
    journal = {Proceedings of the Royal Society A},
    volume = {429},
    pages = {141--173},
    year = {1990},
}"""

TERAN_2005 = """@inproceedings{teran2005robust,
    author = {Teran, Joseph and Sifakis, Eftychios and Irving, Geoffrey and Fedkiw, Ronald},
    title = {Robust quasistatic finite elements and flesh simulation},
    booktitle = {Proceedings of the 2005 ACM SIGGRAPH/Eurographics Symposium on Computer Animation},
    pages = {181--190},
    year = {2005},
}"""

TIMOSHENKO_1925 = """@article{timoshenko1925analysis,
    author = {Timoshenko, Stephen},
    title = {Analysis of bi-metal thermostats},
    journal = {Journal of the Optical Society of America},
    volume = {11},
    pages = {233--255},
    year = {1925},
}"""

TRELOAR_1975 = """@book{treloar1975physics,
    author = {Treloar, L. R. G.},
    title = {The physics of rubber elasticity},
    edition = {3},
    publisher = {Oxford University Press},
    year = {1975},
}"""

UMEYAMA_1991 = """@article{umeyama1991least,
    author = {Umeyama, Shinji},
    title = {Least-squares estimation of transformation parameters between two point patterns},
    journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
    volume = {13},
    number = {4},
    pages = {376--380},
    year = {1991},
}"""

VAN_REES_2017 = """@article{vanrees2017growth,
    author = {van Rees, Wim M. and Vouga, Etienne and Mahadevan, L.},
    title = {Growth patterns for shape-shifting elastic bilayers},
    journal = {Proceedings of the National Academy of Sciences},
    volume = {114},
    number = {44},
    pages = {11597--11602},
    year = {2017},
}"""

WEISCHEDEL_2012 = """@phdthesis{weischedel2012discrete,
    author = {Weischedel, Clarisse},
    title = {A discrete geometric view on shear-deformable shell models},
    school = {Georg-August-Universit{\\"a}t G{\\"o}ttingen},
    year = {2012},
}"""

WRIGGERS_2006 = """@book{wriggers2006computational,
    author = {Wriggers, Peter},
    title = {Computational contact mechanics},
    edition = {2},
    publisher = {Springer},
    year = {2006},
}"""
