from typing import Any
def read_mjcf(root:Any,path:Any,problems:Any)->Any: raise NotImplementedError
