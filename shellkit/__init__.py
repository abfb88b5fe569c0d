"""Thin elastic shells as trainable models, on JAX and Equinox."""

from . import meshes as meshes
from ._actuation import (
    Actuation as Actuation,
    Bilayer as Bilayer,
    IsotropicGrowth as IsotropicGrowth,
    Laminate as Laminate,
    Layer as Layer,
    Nematic as Nematic,
    NeuralDirectors as NeuralDirectors,
    OrthotropicGrowth as OrthotropicGrowth,
    Passive as Passive,
    Prescribed as Prescribed,
    PrescribedMetric as PrescribedMetric,
    SheetActuation as SheetActuation,
)
from ._align import (
    Aligner as Aligner,
    ICP as ICP,
    Kabsch as Kabsch,
    Landmarks as Landmarks,
    Motion as Motion,
    NoAlignment as NoAlignment,
    Similarity as Similarity,
    register as register,
)
from ._analysis import (
    Hausdorff as Hausdorff,
    hausdorff as hausdorff,
    Identifiability as Identifiability,
    Modes as Modes,
    TaylorReport as TaylorReport,
    identifiability as identifiability,
    energy_density as energy_density,
    membrane_stress as membrane_stress,
    taylor_test as taylor_test,
    vibration_modes as vibration_modes,
)
from ._energy import (
    AreaConstraint as AreaConstraint,
    Bending as Bending,
    Constraint as Constraint,
    DeadLoad as DeadLoad,
    DihedralBending as DihedralBending,
    EdgeLoad as EdgeLoad,
    EdgeMoment as EdgeMoment,
    EnergyTerm as EnergyTerm,
    FormEnergy as FormEnergy,
    Foundation as Foundation,
    Gravity as Gravity,
    Inflation as Inflation,
    IncompressibleNeoHookean as IncompressibleNeoHookean,
    LaminateEnergy as LaminateEnergy,
    NeoHookean as NeoHookean,
    OrthotropicBending as OrthotropicBending,
    OrthotropicStretching as OrthotropicStretching,
    PlaneContact as PlaneContact,
    Ply as Ply,
    PointLoad as PointLoad,
    Pressure as Pressure,
    SphereContact as SphereContact,
    StVenantKirchhoff as StVenantKirchhoff,
    SurfaceLoad as SurfaceLoad,
    TensionField as TensionField,
    VolumeConstraint as VolumeConstraint,
)
from ._equilibrium import Equilibrium as Equilibrium, RESULTS as RESULTS
from ._export import load as load, save as save, write_series as write_series
from ._fabrication import (
    export_directors as export_directors,
    export_streamlines as export_streamlines,
    streamlines as streamlines,
    thicken as thicken,
)
from ._fit import (
    Accepted as Accepted,
    Bounds as Bounds,
    Checkpoint as Checkpoint,
    Course as Course,
    Dogleg as Dogleg,
    Evaluation as Evaluation,
    FitResult as FitResult,
    FitStep as FitStep,
    GaussNewton as GaussNewton,
    History as History,
    JsonLines as JsonLines,
    LevenbergMarquardt as LevenbergMarquardt,
    ManyFits as ManyFits,
    Method as Method,
    NielsenDamping as NielsenDamping,
    Objective as Objective,
    Refuse as Refuse,
    Stop as Stop,
    TensorBoard as TensorBoard,
    WarmStart as WarmStart,
    fit as fit,
    fit_many as fit_many,
    load_checkpoint as load_checkpoint,
)
from ._geometry.curvature import (
    angle_defects as angle_defects,
    dihedral_angles as dihedral_angles,
    gauss_curvature as gauss_curvature,
    mean_curvature as mean_curvature,
    voronoi_areas as voronoi_areas,
)
from ._geometry.directors import director_angles as director_angles, directors as directors
from ._geometry.forms import first_form as first_form, second_form as second_form
from ._geometry.surface import (
    edge_lengths as edge_lengths,
    enclosed_volume as enclosed_volume,
    face_areas as face_areas,
    face_frames as face_frames,
    face_normals as face_normals,
    surface_area as surface_area,
    vertex_areas as vertex_areas,
)
from ._geometry.intersections import self_intersections as self_intersections
from ._geometry.transfer import transfer_directors as transfer_directors, transfer_face_values as transfer_face_values
from ._loss import (
    Area as Area,
    Chamfer as Chamfer,
    DirectorSmoothness as DirectorSmoothness,
    FoldPenalty as FoldPenalty,
    GaussCurvature as GaussCurvature,
    LandmarkDistance as LandmarkDistance,
    LeastSquaresLoss as LeastSquaresLoss,
    Loss as Loss,
    MeanCurvature as MeanCurvature,
    PointToSurface as PointToSurface,
    Sphericity as Sphericity,
    StrainLimit as StrainLimit,
    SumOfLosses as SumOfLosses,
    Varifold as Varifold,
    VertexDistance as VertexDistance,
    Volume as Volume,
    WeightedLoss as WeightedLoss,
)
from ._mesh import (
    Mesh as Mesh,
    MeshDataWarning as MeshDataWarning,
    MeshFileError as MeshFileError,
    MeshTopologyWarning as MeshTopologyWarning,
)
from ._package.about import about as about
from ._package.distribution import __version__ as __version__
from ._path import (
    ArcLength as ArcLength,
    Branch as Branch,
    CriticalPoint as CriticalPoint,
    DistinctEquilibria as DistinctEquilibria,
    Path as Path,
    Ramp as Ramp,
    continue_path as continue_path,
    distinct_equilibria as distinct_equilibria,
    follow as follow,
    relax as relax,
    switch_branch as switch_branch,
    trace as trace,
)
from ._plot import (
    Film as Film,
    Snapshots as Snapshots,
    animate as animate,
    plot as plot,
    plot_history as plot_history,
)
from ._problem import Equilibria as Equilibria, InverseProblem as InverseProblem, States as States
from ._programs.waiting import keep_compiled as keep_compiled
from ._rest import RestShape as RestShape
from ._starts import (
    Feasibility as Feasibility,
    bilayer_inverse as bilayer_inverse,
    feasibility as feasibility,
    nematic_start as nematic_start,
)
from ._solve.linear.choose import direct_solver as direct_solver, linear_solver as linear_solver
from ._solve.linear.cholmod import Cholmod as Cholmod
from ._solve.linear.iterative import ConjugateGradients as ConjugateGradients
from ._solve.newton.corrections import Corrections as Corrections
from ._solve.newton.line_search import LineSearch as LineSearch
from ._solve.newton.mixed import MixedSteps as MixedSteps
from ._solve.newton.newton import SparseNewton as SparseNewton
from ._solve.newton.saddle import SaddleEscape as SaddleEscape
from ._solve.newton.shift import Shift as Shift
from ._solve.matrices.operator import SparseSymmetric as SparseSymmetric
from ._solve.linear.pardiso import Pardiso as Pardiso
from ._solve.linear.superlu import SuperLU as SuperLU
from ._supports import (
    Clamped as Clamped,
    Pinned as Pinned,
    Sliding as Sliding,
    Supports as Supports,
    Symmetry as Symmetry,
)
