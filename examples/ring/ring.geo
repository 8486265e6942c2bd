// A ring of radii 10 mm and 20 mm, finer inside: gmsh -2 -format msh41 ring.geo
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 20};
Disk(2) = {0, 0, 0, 10};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Mesh.MeshSizeMin = 0.9;
Mesh.MeshSizeMax = 1.6;
Field[1] = MathEval;
Field[1].F = "0.9 + 0.07*(Sqrt(x*x + y*y) - 10)";
Background Field = 1;
Mesh.MeshSizeExtendFromBoundary = 0;
Physical Surface("ring") = {3};
Physical Curve("outside") = {1};
Physical Curve("bore") = {2};
