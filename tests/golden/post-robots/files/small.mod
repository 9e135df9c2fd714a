MODULE small
  ! small.cl for lola50-six, six, by polypod post
  ! workpiece origin in M X0 Y-1300 Z0 mm, posture front elbow-up
  PERS tooldata tPart:=[TRUE,[[0,0,0],[0,0.707106781,-0.707106781,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,-1300,0],[1,0,0,0]]];
  CONST zonedata zPart:=[FALSE,0.1,0.1,0.1,0.01,0.1,0.01];
  PROC main()
    ConfL\Off;
    ! PARTNO SMALL
    ! tool 2, spindle 8000 rev/min clockwise, coolant off
    MoveJ [[0,0,60],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[100,500,5000,1000],fine,tPart\WObj:=wPart;
    MoveL [[20,0,5],[0.996194698,0,0.087155743,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[100,500,5000,1000],fine,tPart\WObj:=wPart;
    MoveL [[20,0,0],[0.996194698,0,0.087155743,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],zPart,tPart\WObj:=wPart;
    MoveL [[0,20,0],[0.996194698,-0.087155743,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],zPart,tPart\WObj:=wPart;
    MoveL [[-20,0,0],[0.996194698,0,-0.087155743,0],[-1,-1,-1,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],zPart,tPart\WObj:=wPart;
    MoveL [[0,0,10],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],zPart,tPart\WObj:=wPart;
    MoveC [[2.9289,7.0711,10],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[[10,10,10],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],zPart,tPart\WObj:=wPart;
    MoveC [[17.0711,7.0711,10],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[[20,0,10],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[10,500,5000,1000],fine,tPart\WObj:=wPart;
    WaitTime 0.5;
    Stop;
    MoveL [[0,0,60],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[100,500,5000,1000],fine,tPart\WObj:=wPart;
  ENDPROC
ENDMODULE
