// A pipe bend: a ring of four transfinite quarters swept through a quarter turn.
r1 = 6; r2 = 14; R = 26;
Point(1) = {R, 0, 0};
For i In {0:3}
  a = i * Pi / 2 + Pi / 4;
  Point(10 + i) = {R + r1 * Cos(a), 0, r1 * Sin(a)};
  Point(20 + i) = {R + r2 * Cos(a), 0, r2 * Sin(a)};
EndFor
For i In {0:3}
  j = (i + 1) % 4;
  Circle(30 + i) = {10 + i, 1, 10 + j};
  Circle(40 + i) = {20 + i, 1, 20 + j};
  Line(50 + i) = {10 + i, 20 + i};
EndFor
For i In {0:3}
  j = (i + 1) % 4;
  // Every other quarter begins at another corner, so that its hexes are numbered otherwise.
  If (i % 2)
    Curve Loop(60 + i) = {30 + i, 50 + j, -(40 + i), -(50 + i)};
  Else
    Curve Loop(60 + i) = {50 + j, -(40 + i), -(50 + i), 30 + i};
  EndIf
  Plane Surface(70 + i) = {60 + i};
  Transfinite Curve {30 + i, 40 + i} = 4;
  Transfinite Curve {50 + i} = 3;
  Transfinite Surface {70 + i};
  Recombine Surface {70 + i};
EndFor
Extrude { {0, 0, 1}, {0, 0, 0}, Pi / 2 } { Surface{70, 71, 72, 73}; Layers{10}; Recombine; }
Mesh.ElementOrder = 2;
Mesh.SecondOrderIncomplete = 0;
Physical Volume("bend") = {1, 2, 3, 4};
